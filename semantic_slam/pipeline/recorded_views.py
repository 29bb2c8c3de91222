"""Writes pose, path and markers into the belief bags of offline runs, for RViz and Foxglove."""

import numpy as np

from semantic_slam.bag.writer import BagWriter
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages import topics
from semantic_slam.pipeline.plain_views import NEWEST, MarkersView, path_view, pose_view

EVERY = 20
"""Interval in keyframes between recorded paths and marker sets, whose sizes grow with the run."""


class RecordedViews:
    """Writes the pose of every belief, and path and markers of every 20th belief and of the last one."""

    def __init__(self) -> None:
        self._stamps_ns: list[int] = []
        self._poses: list[Array] = []
        self._markers = MarkersView()
        self._newest: HybridBelief | None = None

    def add(self, belief: HybridBelief, writer: BagWriter) -> None:
        """Write the views of the next belief."""
        estimate = pose_view(belief)
        writer.write(topics.POSE, estimate, belief.stamp_ns)
        self._stamps_ns.append(belief.stamp_ns)
        self._poses.append(estimate.pose)
        self._newest = belief
        if belief.keyframe % EVERY == 0:
            self._write(belief, writer, NEWEST)

    def finish(self, writer: BagWriter) -> None:
        """Write the whole path, and the markers of the last belief."""
        if self._newest is not None:
            self._write(self._newest, writer, len(self._poses))

    def _write(self, belief: HybridBelief, writer: BagWriter, most: int) -> None:
        path = path_view(self._stamps_ns[-most:], np.array(self._poses[-most:]))
        writer.write(topics.PATH, path, belief.stamp_ns)
        writer.write(topics.MARKERS, self._markers.of(belief), belief.stamp_ns)
