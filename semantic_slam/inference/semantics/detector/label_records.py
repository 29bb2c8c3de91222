"""Label evidence of one object: of the boxes so far, and tentatively with one more."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.viewpoint.labels.record import LabelRecord, LabelView
from semantic_slam.viewpoint.labels.views import WeighedView
from semantic_slam.viewpoint.size_model import SizeRecord


@dataclass(frozen=True, kw_only=True)
class LabelledBox:
    """One box: its label, viewpoint and apparent size."""

    detection: tuple[int, int]  # keyframe, and index among its detections
    view: LabelView
    log_size: float  # of the size in metres that it shows at its range; NaN: unknown
    range_sigma: float  # of the logarithm of that range
    track: str


@dataclass(frozen=True, kw_only=True)
class LabelEvidence:
    """Label evidence of one object; R settings of the detector, C classes."""

    record: LabelRecord
    sizes: SizeRecord | None  # None: sizes are not used
    track: str  # of its newest box
    log_evidence: Array  # (R,) sum over classes
    shares: Array  # (R, C) likelihood relative to the largest under any setting
    log_greatest: Array  # (C,)
    log_prior: Array  # (C,) of its class: the default, or the map's
    log_ratios: Array  # (C,) its change at the first detection, see :class:`NewClasses`
    boxes: tuple[LabelledBox, ...] = ()  # all of them, where they may be reassigned later


def label_evidence_of(parent: Component) -> dict[int, LabelEvidence]:
    """The label evidence of the objects of a hypothesis that have any."""
    return {number: views.recent[0] for number, views in parent.views.items()}


class NewLabelEvidence:
    """Label evidence of one object with one more box; its record is made only if it is kept."""

    def __init__(
        self,
        weighed: WeighedView,
        sizes: SizeRecord | None,
        log_evidence: Array,
        before: LabelEvidence | None,
        earlier: LabelEvidence | None,
        priors: tuple[Array, Array],
        box: LabelledBox,
        *,
        keeps_boxes: bool,
    ) -> None:
        """``priors``: ``log_prior`` and ``log_ratios`` of :class:`LabelEvidence`."""
        self._weighed, self._sizes, self._earlier, self._box = weighed, sizes, earlier, box
        self._log_evidence, self._priors, self._keeps_boxes = log_evidence, priors, keeps_boxes
        self.gain = log_evidence if before is None else log_evidence - before.log_evidence
        """(R,) log evidence of the boxes of this keyframe."""

    @cached_property
    def evidence(self) -> LabelEvidence:
        """The label evidence of the object with this box."""
        logs = self._weighed.by_setting
        if self._sizes is not None:
            logs = logs + self._sizes.log_likelihood
        greatest = logs.max(axis=0)
        return LabelEvidence(
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
    def _boxes(self) -> tuple[LabelledBox, ...]:
        if not self._keeps_boxes:
            return ()
        return (self._box,) if self._earlier is None else (*self._earlier.boxes, self._box)
