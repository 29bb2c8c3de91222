"""What a detector's words tell of one object: those so far, and those with one more box, which may not be kept."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.viewpoint.labels.record import LabelRecord, LabelView
from semantic_slam.viewpoint.labels.views import WeighedView
from semantic_slam.viewpoint.size_model import SizeRecord


@dataclass(frozen=True, kw_only=True)
class ToldBox:
    """One box: what it is called from where, and how large it looks."""

    detection: tuple[int, int]  # keyframe, and place among its detections
    view: LabelView
    log_angle: float  # logarithm of its size per range; NaN: not told
    range_sigma: float  # of the logarithm of the range
    track: str


@dataclass(frozen=True, kw_only=True)
class ToldWords:
    """What the words of one object tell; R settings of the detector, C classes."""

    record: LabelRecord
    sizes: SizeRecord | None  # None: boxes tell no sizes
    track: str  # of its newest box
    log_evidence: Array  # (R,) sum over classes
    shares: Array  # (R, C) likelihood, as shares of the greatest under any setting
    log_greatest: Array  # (C,)
    log_prior: Array  # (C,) of its class, as any object's that nobody has seen, or as a map has it
    log_ratios: Array  # (C,) by which that was another one when it was first seen, see :class:`NewClasses`
    boxes: tuple[ToldBox, ...] = ()  # all, where they may be taken for other objects' later on


def told_so_far(parent: Component) -> dict[int, ToldWords]:
    """What words tell of each object of a hypothesis that has any."""
    return {number: views.recent[0] for number, views in parent.views.items()}


class NewWords:
    """What the words of one object tell with one more box, whose record is made where it is kept."""

    def __init__(
        self,
        weighed: WeighedView,
        sizes: SizeRecord | None,
        log_evidence: Array,
        before: ToldWords | None,
        earlier: ToldWords | None,
        priors: tuple[Array, Array],
        box: ToldBox,
        *,
        keeps_boxes: bool,
    ) -> None:
        """``priors``: as in :class:`ToldWords`, before the words and by what they were another one."""
        self._weighed, self._sizes, self._earlier, self._box = weighed, sizes, earlier, box
        self._log_evidence, self._priors, self._keeps_boxes = log_evidence, priors, keeps_boxes
        self.gain = log_evidence if before is None else log_evidence - before.log_evidence
        """(R,) log evidence of the boxes of this keyframe."""

    @cached_property
    def told(self) -> ToldWords:
        """What the words of the object tell with this box, and their record."""
        logs = self._weighed.by_setting
        if self._sizes is not None:
            logs = logs + self._sizes.log_likelihood
        greatest = logs.max(axis=0)
        return ToldWords(
            record=self._weighed.record,
            sizes=self._sizes,
            track=self._box.track,
            log_evidence=self._log_evidence,
            shares=np.exp(logs - greatest),
            log_greatest=greatest,
            log_prior=self._priors[0],
            log_ratios=self._priors[1],
            boxes=self._boxes,
        )

    @property
    def _boxes(self) -> tuple[ToldBox, ...]:
        if not self._keeps_boxes:
            return ()
        return (self._box,) if self._earlier is None else (*self._earlier.boxes, self._box)
