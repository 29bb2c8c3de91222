"""Where in a bag a player begins that was started again while the other nodes stood still."""

import struct
from collections.abc import Iterable
from dataclasses import dataclass

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.messages.standard import NANOSECONDS

STAMP_AT = 4
"""Bytes of a CDR message before the stamp of its header, which comes first."""
MARGIN = 8
"""Frames before the newest one done with that are sent again, for what was under way is lost with its sender."""


@dataclass(frozen=True, kw_only=True)
class Resumption:
    """The first frame to be sent, and from which log time on what is no frame: that before it, whose pictures it may
    need.
    """

    frame: int = 0
    log_time_ns: int = 0

    def takes(self, message: RawMessage, frame: int | None) -> bool:
        """Whether a message is to be sent; ``frame`` is its number among the frames, None for what is none."""
        return message.stamp_ns >= self.log_time_ns if frame is None else frame >= self.frame


FROM_THE_START = Resumption()


def resumption(frames: Iterable[RawMessage], stamp_ns: int) -> Resumption:
    """Before the newest frame that is done with, by its stamp; where the bag does not have it, from the start."""
    log_times: list[int] = []
    found = -1
    for number, message in enumerate(frames):
        log_times.append(message.stamp_ns)
        if header_stamp_ns(message.cdr) == stamp_ns:
            found = number
    first = found - MARGIN
    return Resumption(frame=first, log_time_ns=log_times[first - 1]) if first > 0 else FROM_THE_START


def header_stamp_ns(cdr: bytes) -> int:
    """Stamp of a message that begins with its header; 0 for what is too short to have one."""
    if len(cdr) < STAMP_AT + 8:
        return 0
    seconds, nanoseconds = struct.unpack_from("<iI" if cdr[1] & 1 else ">iI", cdr, STAMP_AT)
    return int(seconds) * NANOSECONDS + int(nanoseconds)
