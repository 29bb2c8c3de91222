"""Leaves out detections whose labels appear during a run and are no class of its class models.

A network gives one of its own classes to whatever a box shows: a refrigerator would become a cabinet. Where such labels
are known at its start a run is refused; those of a live detector may come later.
"""

from collections import Counter
from dataclasses import replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.messages import topics
from semantic_slam.pipeline.detector_labels import class_names_of, is_meant
from semantic_slam.reasons import bounded, quoted


class UnmeantLabels:
    """What is left out of a run's keyframes after its first one; ``dropped`` counts it by label."""

    STATE: ClassVar[tuple[str, ...]] = ("dropped", "_news")

    def __init__(self, configuration: Configuration) -> None:
        self.dropped: Counter[str] = Counter()
        self._configuration = configuration
        self._news: list[str] = []

    def without(self, keyframe: Keyframe) -> Keyframe:
        """The keyframe without detections that a network has classified and whose labels are none of its classes.

        Labels that ``perception.labels`` does not list are left to the classifier, as at the start of a run.
        """
        measured = keyframe.measurements
        if measured.class_probability_samples.shape[1] == 0:
            return keyframe
        unmeant = [self._is_unmeant(label) for label in measured.labels]
        if not any(unmeant):
            return keyframe
        for label in np.array(measured.labels, dtype=object)[unmeant]:
            self._count(label)
        return replace(keyframe, measurements=measured.take(np.flatnonzero(~np.array(unmeant))))

    def news(self) -> list[str]:
        """A line for each label that was left out for the first time since this was last called."""
        told, self._news = self._news, []
        return told

    @cached_property
    def _class_names(self) -> tuple[str, ...]:
        return class_names_of(self._configuration.semantic_model)

    def _is_unmeant(self, label: str) -> bool:
        wanted = self._configuration.perception.labels
        return (not wanted or label in wanted) and not is_meant(label, self._class_names)

    def _count(self, label: str) -> None:
        reason = bounded(self.dropped, f"{topics.MEASUREMENTS}: unknown label {quoted(label)}")
        if reason not in self.dropped:
            self._news.append(
                f"detections labelled {quoted(label)} are left out: it is none of the classes of the class models"
                f" ({', '.join(self._class_names)}); start again with config/detector.yaml to go by the detector's"
                " labels"
            )
        self.dropped[reason] += 1
