"""What was saved of a damaged bag, and what is lost."""

from collections.abc import Iterable

from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.recording import Note


def loss_sentence(bag: Bag, topics: Iterable[str]) -> str:
    """Say how many messages and seconds of some topics were saved; empty for a whole bag."""
    if not bag.damages:
        return ""
    parts = "; ".join(_topic_sentence(bag, topic) for topic in topics)
    return f"{' and '.join(bag.damages)}: {parts}"


def loss_notes(bag: Bag, topics: Iterable[str]) -> list[Note]:
    """Return the same as a note; it limits the recording if a message of the topics is lost."""
    listed = list(topics)
    sentence = loss_sentence(bag, listed)
    if not sentence:
        return []
    lost = not bag.counted or any(bag.missing[topic] for topic in listed)
    return [Note("", sentence, 1, limits=lost)]


def _topic_sentence(bag: Bag, topic: str) -> str:
    found, missing = bag.found[topic], bag.missing[topic]
    interval = bag.intervals.get(topic, 0.0)
    saved = f"{found * interval:.4g} s"
    if not bag.counted:
        least = f"at least {missing} and perhaps more" if missing else "how many more there were"
        tail = "are lost" if missing else "is not known"
        return f"{found} messages on {topic} ({saved}) were saved, {least} {tail}"
    if not missing:
        return f"no message on {topic} is lost"
    lost = f" ({missing * interval:.3g} s)" if interval else ""
    return f"{missing} messages on {topic}{lost} are lost, {found} ({saved}) were saved"
