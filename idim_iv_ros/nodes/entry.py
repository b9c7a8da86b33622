"""Functions of all nodes: run until a signal, timers, threads, folders named by time."""

import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Protocol, TypeVar

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer
from rclpy.utilities import try_shutdown

from idim_iv_ros.errors import IdimError, UsageError, one_line, silence_foreign_warnings
from idim_iv_ros.nodes.parameters import refuse_unknown_arguments

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Quality of service of a topic whose last message reaches those who subscribe later."""

_WAIT = 0.2  # s until a signal is noticed

Result = TypeVar("Result")


class Closable(Protocol):
    """A node that `run_node` can run and close."""

    node: Node

    def close(self) -> None:
        """End all activity, and destroy the node."""


class CannotGoOnError(Exception):
    """Raised in a callback, ends the node; `why` is printed."""

    def __init__(self, why: IdimError) -> None:
        super().__init__(str(why))
        self.why = why


def run_node(
    name: str, make: Callable[[Sequence[str]], Closable], about: str, arguments: Sequence[str]
) -> int:
    """Run a node until SIGINT or SIGTERM and return the exit status.

    An error in a callback is logged in one line and the node goes on, unless it is a
    `CannotGoOnError`. The executor still runs while the node is closed.
    """
    if {"-h", "--help"} & set(arguments[1:]):
        print(about)
        return 0
    silence_foreign_warnings()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        try:
            with warnings.catch_warnings():
                # After a failed construction rclpy warns that the node cannot be destroyed.
                warnings.simplefilter("ignore", RuntimeWarning)
                refuse_unknown_arguments(arguments)
                rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
                running = make(arguments)
        except IdimError:
            raise
        except Exception as error:  # what rclpy raises has no common class
            text = one_line(error)
            words = f"cannot start: {text}"
            if "security libraries" in text or os.environ.get("ROS_SECURITY_ENABLE") == "true":
                words = (
                    f"DDS security is switched on (ROS_SECURITY_ENABLE) and cannot begin ({text}): "
                    "does ROS_SECURITY_KEYSTORE hold an enclave for this node, and has this ROS 2 "
                    "DDS security (the wheels of PyPI have none)?"
                )
            raise UsageError(words) from error
        executor = SingleThreadedExecutor()
        executor.add_node(running.node)
        try:
            while not stop.is_set():
                try:
                    executor.spin_once(timeout_sec=_WAIT)
                except CannotGoOnError as error:
                    raise error.why from error
                except Exception as error:  # one bad request must not end the recording
                    running.node.get_logger().error(one_line(error))
        finally:
            running.close()
    except IdimError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_status
    finally:
        try_shutdown()
    return 0


def steady_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Return a timer that runs every `period` seconds whatever the clock of ROS says."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def promised(function: Callable[[], Result]) -> tuple[Future[Result], Callable[[], None]]:
    """Return a future of a function's result, and what another thread calls to compute it."""
    future: Future[Result] = Future()

    def work() -> None:
        try:
            future.set_result(function())
        except Exception as error:  # belongs to whoever asks the future
            future.set_exception(error)

    return future, work


def in_thread(function: Callable[[], Result], name: str) -> Future[Result]:
    """Call a function in a daemon thread, and return a future of its result."""
    future, work = promised(function)
    threading.Thread(target=work, name=name, daemon=True).start()
    return future


def new_folder_path(directory: Path, prefix: str) -> Path:
    """Return a path ``PREFIX_date-time`` in a directory where nothing is yet."""
    stamp = time.strftime(f"{prefix}_%Y_%m_%d-%H_%M_%S")
    folder, number = directory / stamp, 1
    while folder.exists():
        number += 1
        folder = directory / f"{stamp}_{number}"
    return folder
