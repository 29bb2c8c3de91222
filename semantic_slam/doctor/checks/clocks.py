"""Check of clocks: disagreement between odometry and detections, or between senders and the recorder."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, error, warning
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.odometry.odometry_buffer import MAX_EXTRAPOLATION_S

NAME = "clocks"
MOST_OUTSIDE = 0.02
"""Tolerated share of detections outside the time span of odometry, as at the ends of any recording."""
EARLY_S, LATE_S = 0.5, 10.0
"""Tolerated arrival of a message before its stamp, and largest plausible detector delay [s]."""
REMEDY = "synchronise the clocks (chrony, PTP); have detectors copy the image's stamp; use_sim_time the same everywhere"


def check(summary: InputSummary) -> Iterator[Finding]:
    if (np.diff(summary.stamps_of(summary.found.odometry).header_ns) < 0).any():
        return  # what is wrong with the odometry's own clock comes first
    evidence = summary.evidence
    if evidence.later_s:
        yield error(
            NAME,
            f"detections agree with the odometry of {abs(evidence.later_s):.1f} s"
            f" {'later' if evidence.later_s > 0 else 'earlier'} {1.0 / evidence.ratio:.1f} times better than with that"
            " of their stamps",
            f"{REMEDY}; for a recording set odometry.clock_offset_s near {evidence.later_s:g}",
        )
        return
    outside = list(_outside(summary))
    yield from outside or _arrivals(summary)


def _outside(summary: InputSummary) -> Iterator[Finding]:
    odometry, seen = (summary.stamps_of(topic).header_ns for topic in (summary.found.odometry, summary.measured))
    if not len(odometry) or not len(seen):
        return
    first, last = np.quantile(odometry, (0.0, 1.0)).tolist()  # wrong stamps apart, which another check tells
    margin = MAX_EXTRAPOLATION_S * NANOSECONDS
    outside = (seen < first - margin) | (seen > last + margin)
    share = float(outside.mean())
    if share <= MOST_OUTSIDE:
        return
    apart_s = float(np.median(seen - np.clip(seen, first, last))) / NANOSECONDS
    what = (
        f"{int(outside.sum())} of {len(seen)} messages of {summary.measured} ({seen.min() / NANOSECONDS:.3f} to"
        f" {seen.max() / NANOSECONDS:.3f} s) lie outside the time of {summary.found.odometry}"
        f" ({first / NANOSECONDS:.3f} to {last / NANOSECONDS:.3f} s)"
    )
    if share < 1.0:
        yield warning(NAME, what, f"record odometry over the whole drive; where it is there, {REMEDY}")
    else:
        yield error(NAME, f"{what}, by {apart_s:.1f} s", REMEDY)


def _arrivals(summary: InputSummary) -> Iterator[Finding]:
    """Each topic's delay against that of odometry; live against the time of day, or the simulator's, too."""
    delays = {
        topic: float(np.median(stamps.arrival_ns - stamps.header_ns)) / NANOSECONDS
        for topic, stamps in summary.stamps.items()
        if len(stamps) and stamps.header_ns.any()
    }
    own = 0.0 if summary.is_live else delays.get(summary.found.odometry, 0.0)
    against = "its time of arrival" if summary.is_live else f"{summary.found.odometry}, by the times of recording"
    off = {topic: delay_s - own for topic, delay_s in delays.items() if not -EARLY_S <= delay_s - own <= LATE_S}
    if off:
        late_s = max(off.values(), key=abs)
        what = f"{', '.join(off)}: stamped {abs(late_s):.1f} s {'late' if late_s < 0 else 'early'} against {against}"
        yield error(NAME, what, REMEDY)
