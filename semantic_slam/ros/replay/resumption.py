"""Finds the position in a bag from which a restarted player resumes the replay."""

import struct
from collections.abc import Iterable
from dataclasses import dataclass

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.messages.standard import NANOSECONDS

STAMP_AT = 4
"""Offset in bytes of the header stamp in a CDR message that begins with its header."""
MARGIN = 8
"""Frames before the newest processed one that are sent again, as messages in flight are lost with their sender."""


@dataclass(frozen=True, kw_only=True)
class Resumption:
    """Position in a bag: the number of the first frame to send, and the log time from which to send all other topics.

    The log time is that of the frame before, so that the images that belong to the first frame are included.
    """

    frame: int = 0
    log_time_ns: int = 0

    def takes(self, message: RawMessage, frame: int | None) -> bool:
        """Whether to send a message; ``frame`` is its number among the frames, None if it is not a frame."""
        return message.stamp_ns >= self.log_time_ns if frame is None else frame >= self.frame


FROM_THE_START = Resumption()


def resumption(frames: Iterable[RawMessage], stamp_ns: int) -> Resumption:
    """Position ``MARGIN`` frames before the last frame with this header stamp; the start if there is none."""
    log_times: list[int] = []
    found = -1
    for number, message in enumerate(frames):
        log_times.append(message.stamp_ns)
        if header_stamp_ns(message.cdr) == stamp_ns:
            found = number
    first = found - MARGIN
    return Resumption(frame=first, log_time_ns=log_times[first - 1]) if first > 0 else FROM_THE_START


def header_stamp_ns(cdr: bytes) -> int:
    """Header stamp of a CDR message that begins with its header; 0 if it is too short."""
    if len(cdr) < STAMP_AT + 8:
        return 0
    seconds, nanoseconds = struct.unpack_from("<iI" if cdr[1] & 1 else ">iI", cdr, STAMP_AT)
    return int(seconds) * NANOSECONDS + int(nanoseconds)
