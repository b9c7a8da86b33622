"""Long bags in segments: hours at a kilohertz are read once, and never held whole."""

from collections.abc import Iterator

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.folder import Bag, with_loss
from idim_iv_ros.recording.read import recording_of
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.recording.request import BagMessages, Request, in_bag

# s; at 1 kHz and seven joints an identification of so much takes less than a gigabyte. Filters
# lose about a tenth of a second at each edge.
SEGMENT = 300.0
# A topic that is this far behind the others, in segments, has ended: nobody waits for it.
_BEHIND = 2


def read_segments(
    bag: Bag, request: Request, seconds: float = SEGMENT
) -> Iterator[Recording | DataError]:
    """Read a bag segment by segment; one of up to one and a half segments is read as a whole.

    Segments end at the same arrival time in all topics. The last one takes what remains, from half
    a segment to one and a half. One that does not hold what is asked for is given as its error:
    others may.

    Raises UsageError: no such bag. DataError or OSError: the bag or its files cannot be read.
    """
    messages = BagMessages(bag, in_bag(bag, request))
    latest = dict.fromkeys(messages.request.topics, 0)
    length, end = round(1e9 * seconds), 0
    for topic, batch in bag.batches(messages.topics):
        if topic in latest and len(batch):
            end = end or int(batch.arrival.min()) + length
            # All topics are half a segment behind the end, as far as they go on. Topics of a chunk
            # come one after the other: when one comes again, the chunk before is done, and a topic
            # that was not in it for two segments has ended.
            while (
                min(latest.values()) >= end + length // 2 or latest[topic] >= end + _BEHIND * length
            ):
                yield _segment(messages.before(end))
                end += length
            latest[topic] = max(latest[topic], int(batch.arrival.max()))
        messages.add(topic, batch)
    while end and max(latest.values()) >= end + length // 2:
        yield _segment(messages.before(end))
        end += length
    yield _segment(messages)


def _segment(messages: BagMessages) -> Recording | DataError:
    try:
        return recording_of(messages)
    except DataError as error:
        return with_loss(error, messages.bag, messages.request.topics)
