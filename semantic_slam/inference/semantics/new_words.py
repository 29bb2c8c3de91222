"""The words of one box, weighed as those of one object or another."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.semantics.interface import SemanticInput
from semantic_slam.inference.semantics.told_words import NewWords, ToldWords
from semantic_slam.viewpoint.labels.confusion import STEP_RAD
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord
from semantic_slam.viewpoint.size_model import SizeModel, SizeRecord


class BoxWords:
    """What a detector calls one box of a keyframe."""

    def __init__(self, model: LabelModel, sizes: SizeModel | None, given: SemanticInput, index: int) -> None:
        words = given.step.words
        assert words is not None
        self._model, self._track = model, given.step.names[index]
        self._word = LabelWord(answer=int(words.answers[index]), shares=words.shares[index])
        self._sizes, self._log_angle = sizes if words.log_angles is not None else None, np.nan
        if words.log_angles is not None:
            self._log_angle = float(words.log_angles[index])
        self._log_prior, self._stretch = given.log_class_prior, model.stretch_of(given.step.stamp_ns)
        self._drawn = dict[int, Array]()  # by sector

    def weighed(
        self,
        before: ToldWords | None,
        earlier: ToldWords | None,
        place: int,
        direction: int,
        log_range: int,
        range_sigma: int,
    ) -> NewWords:
        """As of the object in a place: what words told ``before``, and ``earlier`` with those of this keyframe.

        Seen from where ``view_places`` has it, in steps.
        """
        model, away = self._model, STEP_RAD * float(log_range)
        view = LabelView(word=self._word, direction=direction, log_range=away, stretch=self._stretch)
        record = model.start() if earlier is None else earlier.record
        words, prior = model.weighed(record, view, self._drawn_by(view)), self._log_prior[place]
        sizes = self._with_size(earlier, away, STEP_RAD * range_sigma)
        if sizes is not None:
            prior = prior + sizes.log_likelihood
        evidence = words.log_evidence(model.log_rows(prior))
        return NewWords(words, sizes, self._track, evidence, before)

    def _drawn_by(self, view: LabelView) -> Array:
        """Counts that the view draws from, found once for each sector."""
        sector = self._model.sector_of(view)
        if sector not in self._drawn:
            self._drawn[sector] = self._model.drawn(view)
        return self._drawn[sector]

    def _with_size(self, before: ToldWords | None, log_range: float, sigma: float) -> SizeRecord | None:
        """What boxes tell of one object with this one, at a range; as before where this one shows no size."""
        if self._sizes is None:
            return None
        record = (before and before.sizes) or self._sizes.start()
        shown = self._log_angle + log_range
        return record if np.isnan(shown) else self._sizes.after(record, shown, sigma**2)
