"""The label evidence of one new box, as one of each candidate object."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.spatial.log_range import LogRange
from semantic_slam.inference.semantics.detector.label_records import LabelEvidence, LabelledBox, NewLabelEvidence
from semantic_slam.inference.semantics.interface import SemanticInput
from semantic_slam.inference.semantics.view_steps import ViewSteps
from semantic_slam.viewpoint.labels.confusion import STEP_RAD
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord
from semantic_slam.viewpoint.size_model import SizeModel, SizeRecord


@dataclass(frozen=True, kw_only=True)
class BoxModels:
    """The likelihood models of the boxes of an object."""

    labels: LabelModel
    sizes: SizeModel | None  # None: box sizes are not used
    anywhere: LogRange  # prior of the range of a new object seen without one, apart from its size
    keeps_boxes: bool  # keep every box, as it may be reassigned later

    def weighed(
        self,
        box: LabelledBox,
        before: LabelEvidence | None,
        earlier: LabelEvidence | None,
        log_prior: Array,
        log_ratios: Array,
        drawn: Array,
    ) -> NewLabelEvidence:
        """One more box of an object, given its evidence ``before`` this keyframe and ``earlier`` within it.

        ``log_prior`` (C,): the object's class prior before the run. ``log_ratios`` (C,): its change if this is the
        first box. ``drawn``: as the label model computes it for the view.
        """
        ratios = log_ratios if earlier is None else earlier.log_ratios
        record = self.labels.start() if earlier is None else earlier.record
        words, sizes = self.labels.weighed(record, box.view, drawn), self._with_size(earlier, box)
        prior = log_prior + ratios if sizes is None else log_prior + ratios + sizes.log_likelihood
        evidence = words.log_evidence(self.labels.log_rows(prior))
        priors = log_prior, ratios
        return NewLabelEvidence(words, sizes, evidence, before, earlier, priors, box, keeps_boxes=self.keeps_boxes)

    def _with_size(self, before: LabelEvidence | None, box: LabelledBox) -> SizeRecord | None:
        """The size record of one object with this box; unchanged where the box has no size."""
        if self.sizes is None:
            return None
        record = (before and before.sizes) or self.sizes.start()
        if np.isnan(box.log_size):
            return record
        return self.sizes.after(record, box.log_size, box.range_sigma**2)


class BoxWords:
    """The labels of one box of a keyframe."""

    def __init__(self, models: BoxModels, given: SemanticInput, index: int) -> None:
        words = given.step.words
        assert words is not None
        self._models, self._track = models, given.step.names[index]
        self._detection = given.step.index, index
        self._word = LabelWord(answer=int(words.answers[index]), shares=words.shares[index])
        self._log_angle = np.nan if words.log_angles is None else float(words.log_angles[index])
        self._log_prior, self._stretch = given.log_class_prior, models.labels.stretch_of(given.step.stamp_ns)
        self._drawn = dict[int, Array]()  # by sector

    def weighed(
        self,
        before: LabelEvidence | None,
        earlier: LabelEvidence | None,
        column: int,
        log_ratios: Array,
        steps: ViewSteps,
        *,
        is_new: bool,
    ) -> NewLabelEvidence:
        """The box as one of the object at index ``column``, given its evidence ``before`` and ``earlier`` in the frame.

        ``log_ratios`` (C,): change of its class prior if this
        is its first detection. ``is_new``: this box starts the object. Its range then counts as unknown for its size,
        as the range's prior follows from the size that its label lets expect.
        """
        log_range = STEP_RAD * float(steps.log_range)
        at = self._models.anywhere if is_new else LogRange(log_range, STEP_RAD * steps.range_sigma)
        view = LabelView(
            word=self._word,
            direction=steps.direction,
            log_range=log_range,
            elevation=steps.elevation,
            stretch=self._stretch,
        )
        box = LabelledBox(
            detection=self._detection,
            view=view,
            log_size=self._log_angle + at.mean,
            range_sigma=at.sigma,
            track=self._track,
        )
        return self._models.weighed(box, before, earlier, self._log_prior[column], log_ratios, self._drawn_by(view))

    def _drawn_by(self, view: LabelView) -> Array:
        """Counts that the view draws from, computed once per sector."""
        sector = self._models.labels.sector_of(view)
        if sector not in self._drawn:
            self._drawn[sector] = self._models.labels.drawn(view)
        return self._drawn[sector]
