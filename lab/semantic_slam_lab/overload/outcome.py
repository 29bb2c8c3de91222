"""What was measured of live nodes that are sent more than they can use, and what it is to show."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from pathlib import Path

from semantic_slam.errors import InputError
from semantic_slam.ros.wire.qos import SENSOR_DEPTH
from semantic_slam_lab.studies.result import Claim, Table

SOURCE = "this project"
ROW_S = 5.0
"""From one row to the next."""
LEAST_S = 3 * ROW_S
"""Shorter runs have fewer than the two rows between which beliefs have to come."""
GROWN = 1.1
QUEUED = 2 * SENSOR_DEPTH
"""Frames that may wait before classifier and manager."""
SETTLED = 1000
"""Keyframe from which on memory is compared."""


@dataclass(frozen=True)
class Row:
    """The state at one instant."""

    seconds: float
    sent: int
    keyframe: int
    late_s: float  # the newest belief, when it came
    latest_s: float  # the latest of the beliefs since the row before, when it came
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


def check_seconds(seconds: float) -> None:
    """Raises InputError for a run that is too short to show anything."""
    if not seconds >= LEAST_S:
        raise InputError(f"--seconds {seconds:g}: too short to show anything; give at least {LEAST_S:g}")


def claims_of(rows: Sequence[Row]) -> list[Claim]:
    """Delay, drops and memory; the last row is of nodes that are done. Raises InputError for fewer than two rows."""
    if len(rows) < 2:
        raise InputError(f"{len(rows)} rows, and delay shows between two; give a greater --seconds")
    taken, last = max(behind(rows)), rows[-1]
    missing = last.sent - (last.keyframe + 1) - last.dropped
    return [
        Claim(
            f"beliefs come all along, and none is later than what {QUEUED} frames take, as many as may wait before two"
            " nodes",
            SOURCE,
            "",
            _silence(rows) or f"{taken:.0f} frames; {max(row.latest_s for row in rows):.1f} s at most",
            taken <= QUEUED,
        ),
        Claim(
            "whatever was sent has become a keyframe or is counted as dropped, once the nodes are done with it",
            SOURCE,
            "",
            f"{last.sent} sent, {last.keyframe + 1} keyframes, {last.dropped} dropped, {missing} neither",
            missing == 0,
        ),
        *(
            Claim(
                f"memory of {name} does not grow by more than {GROWN - 1:.0%} from keyframe {SETTLED} on",
                SOURCE,
                "",
                f"{factor:.3f} times at keyframe {last.keyframe}",
                factor <= GROWN,
            )
            for name, factor in growth(rows).items()
        ),
    ]


def behind(rows: Sequence[Row]) -> list[float]:
    """How many frames are used, at the rate between two rows, in the time by which the latest belief is late there.

    Infinite where no belief came: what is stuck is later than anything.
    """
    return [
        later.latest_s * (later.keyframe - earlier.keyframe) / (later.seconds - earlier.seconds)
        if later.keyframe > earlier.keyframe
        else inf
        for earlier, later in pairwise(rows)
    ]


def _silence(rows: Sequence[Row]) -> str:
    """When no belief came from one row to the next, for the first time; "" where one always did."""
    stuck = (pair for pair in pairwise(rows) if pair[1].keyframe <= pair[0].keyframe)
    first = next(stuck, None)
    return f"none from {first[0].seconds:.0f} to {first[1].seconds:.0f} s" if first else ""


def growth(rows: Sequence[Row]) -> dict[str, float]:
    """Memory at the end, as a multiple of that at keyframe :data:`SETTLED`, by node; empty before that."""
    settled = [row for row in rows if row.keyframe >= SETTLED]
    if not settled:
        return {}
    return {name: rows[-1].resident_mb[name] / before for name, before in settled[0].resident_mb.items()}


def table_of(rows: Sequence[Row]) -> Table:
    """A row for each instant."""
    memory = (f"{name} [MB]" for name in rows[0].resident_mb)
    columns = ("seconds", "sent", "keyframe", "late [s]", "latest [s]", "dropped", *memory)
    return Table(
        "Over time",
        columns,
        tuple(
            (
                f"{row.seconds:.0f}",
                str(row.sent),
                str(row.keyframe),
                f"{row.late_s:.1f}",
                f"{row.latest_s:.1f}",
                str(row.dropped),
                *(f"{megabytes:.0f}" for megabytes in row.resident_mb.values()),
            )
            for row in rows
        ),
    )
