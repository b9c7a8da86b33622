"""Subscriptions that no executor touches."""

from rclpy.callback_groups import CallbackGroup


class NeverExecuted(CallbackGroup):
    """Keeps its subscriptions out of every executor: they are emptied by hand."""

    def can_execute(self, entity: object) -> bool:
        """Return False."""
        return False

    def beginning_execution(self, entity: object) -> bool:
        """Return False."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Nothing was begun."""
