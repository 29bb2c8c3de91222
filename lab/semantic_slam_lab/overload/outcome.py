"""What was measured of live nodes that are sent more than they can use, and what it is to show."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from semantic_slam_lab.studies.result import Claim, Table

SOURCE = "this project"
GROWN = 1.1
LATER = 1.5
UNDER_WAY = 150
"""Frames that may be in queues at the end: 50 before each of two nodes, and what DDS keeps."""
SETTLED = 1000
"""Keyframe from which on memory is compared."""


@dataclass(frozen=True)
class Row:
    """The state at one instant."""

    seconds: float
    sent: int
    keyframe: int
    late_s: float
    dropped: int
    resident_mb: Mapping[str, float]

    @property
    def line(self) -> str:
        memory = "  ".join(f"{megabytes:{len(name) + 3}.1f}" for name, megabytes in self.resident_mb.items())
        return f"{self.sent:7d}  {self.keyframe:8d}  {self.late_s:6.2f}  {self.dropped:7d}  {memory}"


def resident_mb(pid: int) -> float:
    """Resident memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def claims_of(rows: Sequence[Row]) -> list[Claim]:
    """Delay, drops and memory."""
    half = len(rows) // 2
    early, late = (max(row.late_s for row in part) for part in (rows[:half], rows[half:]))
    last = rows[-1]
    missing = last.sent - (last.keyframe + 1) - last.dropped
    grown = growth(rows)
    return [
        Claim(
            f"beliefs are no later in the second half than {LATER:g} times as late as in the first",
            SOURCE,
            "",
            f"{early:.1f} s, then {late:.1f} s",
            late <= LATER * early,
        ),
        Claim(
            "whatever is sent becomes a keyframe, is counted as dropped, or is still in a queue",
            SOURCE,
            "",
            f"{last.sent} sent, {last.keyframe + 1} keyframes, {last.dropped} dropped, {missing} neither",
            0 <= missing <= UNDER_WAY,
        ),
        *(
            Claim(
                f"memory of {name} does not grow by more than {GROWN - 1:.0%} from keyframe {SETTLED} on",
                SOURCE,
                "",
                f"{factor:.3f} times",
                factor <= GROWN,
            )
            for name, factor in grown.items()
        ),
    ]


def growth(rows: Sequence[Row]) -> dict[str, float]:
    """Memory at the end, as a multiple of that at keyframe :data:`SETTLED`, by node; empty before that."""
    settled = [row for row in rows if row.keyframe >= SETTLED]
    if not settled:
        return {}
    return {name: rows[-1].resident_mb[name] / before for name, before in settled[0].resident_mb.items()}


def table_of(rows: Sequence[Row]) -> Table:
    """A row for each instant."""
    columns = ("seconds", "sent", "keyframe", "late [s]", "dropped", *(f"{name} [MB]" for name in rows[0].resident_mb))
    return Table(
        "Over time",
        columns,
        tuple(
            (
                f"{row.seconds:.0f}",
                str(row.sent),
                str(row.keyframe),
                f"{row.late_s:.1f}",
                str(row.dropped),
                *(f"{megabytes:.0f}" for megabytes in row.resident_mb.values()),
            )
            for row in rows
        ),
    )
