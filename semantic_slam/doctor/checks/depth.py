"""Check of depth images: wrong unit, wrong size, or no range for the detections."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, error, warning
from semantic_slam.doctor.input_summary import DISPARITIES, InputSummary
from semantic_slam.messages.disparity import UNIT_REMEDY
from semantic_slam.messages.images import FARTHEST_MEDIAN_M, NEAREST_MEDIAN_M
from semantic_slam.pipeline.assembly.frame_assembler import NO_DEPTH

NAME = "depth"
LEAST_RANGED = 0.2
"""Smallest acceptable share of detections with a range in frames that have depth."""
LEAST_DETECTIONS = 20


def check(summary: InputSummary) -> Iterator[Finding]:
    topic, depths = summary.found.depth, summary.depths
    if not depths.encodings:
        return
    encoding = depths.encodings.most_common(1)[0][0]
    if not depths.medians_m:
        yield warning(NAME, f"{topic} ({encoding}) has no valid reading", "check the depth camera and its encoding")
        return
    median_m = float(np.median(depths.medians_m))
    if not NEAREST_MEDIAN_M <= median_m <= FARTHEST_MEDIAN_M:
        yield error(NAME, f"{topic} ({encoding}) has a median of {median_m:.4g} m", _unit_remedy(encoding, median_m))
        return
    yield from _sizes(summary)
    if summary.found.has_images:  # otherwise depth is not used
        yield from _ranges(summary)


def _unit_remedy(encoding: str, median_m: float) -> str:
    if encoding == DISPARITIES:
        return UNIT_REMEDY
    if median_m > FARTHEST_MEDIAN_M:
        return f"it is in millimetres as it seems: divide it by 1000, or send it as 16UC1 ({encoding} is in metres)"
    return f"it is in metres as it seems: multiply it by 1000, or send it as 32FC1 ({encoding} is in millimetres)"


def _sizes(summary: InputSummary) -> Iterator[Finding]:
    camera = summary.camera
    known = {*summary.images.sizes} | ({(camera.width, camera.height)} if camera else set())
    others = [size for size in summary.depths.sizes if known and size not in known]
    for width, height in others[:1]:
        yield error(
            NAME,
            f"{summary.found.depth} is {width} x {height}, unlike the pictures",
            "give depth that is registered to the colour picture (aligned_depth_to_color, depth_registered)",
        )


def _ranges(summary: InputSummary) -> Iterator[Finding]:
    ranges = [each.measurements.ranges_m for each in summary.keyframes]
    known = np.isfinite(np.concatenate(ranges)) if ranges else np.zeros(0, dtype=np.bool_)
    if len(known) >= LEAST_DETECTIONS and known.mean() < LEAST_RANGED * _share_with_depth(summary):
        limit = summary.configuration.perception.max_depth_m
        yield warning(
            NAME,
            f"{int(known.sum())} of {len(known)} detections have a range",
            f"raise perception.max_depth_m ({limit:g} m) if they are farther off, and check that depth is registered",
        )


def _share_with_depth(summary: InputSummary) -> float:
    """Share of the frames with a depth image of their stamp; why others have none, another check tells."""
    without = sum(count for reason, count in summary.dropped.items() if reason.endswith(NO_DEPTH))
    return 1.0 - without / max(summary.num_frames, 1)
