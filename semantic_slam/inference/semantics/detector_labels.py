"""A detector's words as evidence: names that the objects of a hypothesis carry, whatever their heading.

Given the positions of camera and object, and how the detector is set (``LabelModel``: how far its views repeat, whether
scores tell more than words), the words of one object depend on nothing else. The setting is one for all objects of a
hypothesis, which tell it together: with Z_o(r) the sum over classes of the words of object o under setting r,

    P(all words) = sum_r P(r) prod_o Z_o(r),    P(c | all words) ~ P(c) sum_r w_r P(words of o | c, r),

w_r ~ P(r) prod of the Z(r) of all other objects. Ratios of the first are the evidence of associations. Names tell
nothing back to the positions. Where boxes tell sizes (``SizeModel``), an object's boxes are evidence of its class as
its words are, and besides of which object they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.inference.models.detector_words import DetectorWords
from semantic_slam.inference.models.spatial.unmeasured_ranges import sizes_by_label
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.interface import ClassModels, SemanticEvidence, SemanticInput
from semantic_slam.inference.semantics.track_links import NO_TRACK, TrackLinks
from semantic_slam.inference.semantics.view_places import view_places
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.object_views import ObjectViews, class_posterior
from semantic_slam.viewpoint.label_confusion import STEP_RAD
from semantic_slam.viewpoint.label_model import LabelModel
from semantic_slam.viewpoint.label_record import LabelRecord, LabelView
from semantic_slam.viewpoint.size_model import SizeModel, SizeRecord

LEAST_LOG_WEIGHT = -700.0
"""Nats behind the likeliest setting from which on others weigh no less: what no setting explains keeps a logarithm."""


@dataclass(frozen=True, kw_only=True)
class _Told:
    """What the words of one object tell; R settings of the detector."""

    model: LabelModel
    record: LabelRecord
    sizes: SizeRecord | None  # None: boxes tell no sizes
    track: str  # of its newest box
    log_evidence: Array  # (R,) sum over classes

    @classmethod
    def of(
        cls, model: LabelModel, record: LabelRecord, sizes: SizeRecord | None, track: str, log_prior: Array
    ) -> "_Told":
        """What a record tells, with the (C,) log prior of the object's class."""
        known = log_prior if sizes is None else log_prior + sizes.log_likelihood
        joint = record.log_likelihood + model.log_rows(known)
        return cls(model=model, record=record, sizes=sizes, track=track, log_evidence=finite_log_sum_exp(joint, axis=1))

    @property
    def by_setting(self) -> Array:
        """(R, C) log likelihood."""
        words = self.model.by_setting(self.record)
        return words if self.sizes is None else words + self.sizes.log_likelihood

    @cached_property
    def shares(self) -> tuple[Array, Array]:
        """(R, C) likelihood as shares of the greatest under any setting, and (C,) the log of that; for what is kept."""
        logs = self.by_setting
        greatest = logs.max(axis=0)
        return np.exp(logs - greatest), greatest


class DetectorLabels:
    """Evidence of a detector's words, with what each object was called so far as its record."""

    def __init__(self, model: LabelModel, sizes: SizeModel | None = None, tracks: TrackLinks | None = None) -> None:
        self._model, self._sizes, self._tracks = model, sizes, tracks
        self._spelt: tuple[DetectorWords, Array] | None = None  # the newest words, and what each tells by itself

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the label model, which the kind of class models must have."""
        assert models.labels is not None
        errors = models.configuration.open_world.track_error_share
        return cls(models.labels, _size_model(models), TrackLinks(errors) if errors > 0.0 else None)

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Log evidence of the words of each candidate, and the objects' records after it."""
        before = [_told_so_far(parent) for parent in given.parents]
        news, parents = self._news(given, before), given.candidates.assignments.parents.tolist()
        of_parents = np.array([self._of_all(own) for own in before])
        gains = [self._gained(own, before[parent]) for own, parent in zip(news, parents, strict=True)]
        settings = of_parents[parents]  # (K, R)
        after = settings + np.array(gains).reshape(settings.shape)
        evidence = finite_log_sum_exp(after, axis=1) - finite_log_sum_exp(settings, axis=1)
        if self._tracks is not None:
            evidence = evidence + self._of_tracks(self._tracks, given, before)

        def records(rows: Sequence[int]) -> list[dict[int, ObjectViews]]:
            return [_views(before[parents[row]] | news[row], after[row]) for row in rows]

        return replace(SemanticEvidence.of(evidence, []), records=records)

    def _of_tracks(self, links: TrackLinks, given: SemanticInput, before: list[dict[int, _Told]]) -> Array:
        """(K,) log evidence of the tracks of each candidate's boxes."""
        rows, evidence = given.candidates.assignments, np.zeros(len(given.candidates.assignments))
        tracks = [given.step.names[index] for index in given.used.tolist()]
        for parent, told in enumerate(before):
            own = np.flatnonzero(rows.parents == parent)
            table = links.log_pairs(tracks, [one.track for one in told.values()])
            columns = {number: column for column, number in enumerate(told)}
            by_place = np.array([columns.get(number, len(told)) for number in (*given.object_ids, -1)])
            evidence[own] = table[np.arange(len(tracks)), by_place[rows.objects[own]]].sum(axis=1)
        return evidence

    def log_pairs(
        self, step: Step, views: Sequence[ObjectViews | None], log_prior: Array, log_ranges: Array, variances: Array
    ) -> Array:
        """Log evidence of words one by one, as if each were the first of its object's class: enough to rank by."""
        if step.words is None or not len(step.detections):
            return np.zeros((len(step.detections), len(log_prior)))
        if self._spelt is None or self._spelt[0] is not step.words:  # one hypothesis after the other asks for them
            spelt = [self._word(step.words, number) for number in range(len(step.detections))]
            self._spelt = step.words, np.array(spelt)
        told = self._spelt[1]  # (D, C)
        known = np.array([np.zeros(told.shape[1]) if own is None else own.log_likelihood for own in (*views, None)])
        classes = class_posterior(log_prior, known)  # (M + 1, C)
        if self._sizes is None or step.words.log_angles is None:
            found = np.log(np.exp(told) @ classes.T)
        else:
            shown = step.words.log_angles[:, None] + log_ranges
            sizes = self._log_sizes(self._sizes, shown, variances, views)
            found = np.log(np.einsum("dc,mc,dmc->dm", np.exp(told), classes, np.exp(sizes)))
        if self._tracks is not None:
            known_tracks = [NO_TRACK if own is None else own.recent[0].track for own in views]
            found = found + self._tracks.log_pairs(step.names, known_tracks)
        return np.asarray(found)

    def _log_sizes(
        self, model: SizeModel, shown: Array, variances: Array, views: Sequence[ObjectViews | None]
    ) -> Array:
        """(D, M + 1, C) log densities of sizes (D, M + 1) that boxes show, as one of each object, and as one of none.

        0 of those that show none.
        """
        told = [None if own is None else own.recent[0].sizes for own in (*views, None)]
        known = [own or model.start() for own in told]
        means, spreads = np.array([own.mean for own in known]), np.array([own.variance for own in known])
        is_told = np.isfinite(shown)[..., None]
        sizes = np.where(is_told, shown[..., None], 0.0)
        return np.where(is_told, model.log_densities(means, spreads, sizes, variances[..., None]), 0.0)

    def _word(self, words: DetectorWords, number: int) -> Array:
        """(C,) log probability of one word, whatever the setting."""
        view = LabelView(answer=int(words.answers[number]), shares=words.shares[number], direction=0, log_range=0.0)
        by_setting = self._model.by_setting(self._model.after(self._model.start(), view))
        return finite_log_sum_exp(by_setting + self._model.settings.log_weights[:, None], axis=0)

    def _news(self, given: SemanticInput, before: list[dict[int, _Told]]) -> list[dict[int, _Told]]:
        """For each candidate, what is told of the objects of this keyframe with its words."""
        rows, words = given.candidates.assignments, given.step.words
        assert words is not None
        places, news = view_places(given), [dict[int, _Told]() for _ in range(len(rows))]
        stretch = self._model.stretch_of(given.step.stamp_ns)
        known: dict[tuple[int, ...], _Told] = {}
        for number, index in enumerate(given.used.tolist()):
            for row in np.flatnonzero(rows.objects[:, number] >= 0).tolist():
                place = int(rows.objects[row, number])
                object_id = given.object_ids[place]
                earlier = news[row].get(object_id, before[rows.parents[row]].get(object_id))
                seen = int(places.directions[row, number]), int(places.log_ranges[row, number])
                wide = int(places.range_sigmas[row, number])
                key = (id(earlier), index, place, *seen, wide)  # hypotheses share what they have in common
                if key not in known:
                    view = LabelView(
                        answer=int(words.answers[index]),
                        shares=words.shares[index],
                        direction=seen[0],
                        log_range=STEP_RAD * float(seen[1]),
                        stretch=stretch,
                    )
                    sizes = self._with_size(earlier, words, index, view.log_range, STEP_RAD * wide)
                    told = self._model.start() if earlier is None else earlier.record, view
                    record, track = self._model.after(*told), given.step.names[index]
                    known[key] = _Told.of(self._model, record, sizes, track, given.log_class_prior[place])
                news[row][object_id] = known[key]
        return news

    def _with_size(
        self, before: _Told | None, words: DetectorWords, index: int, log_range: float, sigma: float
    ) -> SizeRecord | None:
        """What boxes tell of one object with one more, at a range; as before where that one shows no size."""
        if self._sizes is None or words.log_angles is None:
            return None
        record = (before and before.sizes) or self._sizes.start()
        shown = float(words.log_angles[index]) + log_range
        return record if np.isnan(shown) else self._sizes.after(record, shown, sigma**2)

    def _of_all(self, told: dict[int, _Told]) -> Array:
        """(R,) log probability of each setting with the evidence of all words of a hypothesis."""
        every = [told[number].log_evidence for number in sorted(told)]  # in one order, whoever rebuilt the hypothesis
        return np.asarray(self._model.settings.log_weights + np.sum(every, axis=0))

    def _gained(self, news: dict[int, _Told], before: dict[int, _Told]) -> Array:
        """(R,) log evidence of the words of a keyframe under each setting; 0 where it has none."""
        nothing = np.zeros(self._model.num_settings)
        gains = [own.log_evidence - (before[n].log_evidence if n in before else nothing) for n, own in news.items()]
        return np.sum(gains, axis=0) if gains else nothing


def _size_model(models: ClassModels) -> SizeModel | None:
    """What sizes tell, None where they tell nothing."""
    assert models.labels is not None
    new, share = models.configuration.new_objects, models.configuration.semantic_model.outlier_share
    if new.sigma_log_view <= 0.0:
        return None
    names, known = models.labels.class_names, sizes_by_label(new)
    return SizeModel.of(names, known, new.sigma_log_size, new.sigma_log_view, share)


def _told_so_far(parent: Component) -> dict[int, _Told]:
    return {number: views.recent[0] for number, views in parent.views.items()}


def _views(told: dict[int, _Told], log_settings: Array) -> dict[int, ObjectViews]:
    """The records of all objects, for each of which the others tell how the detector is set; ``log_settings`` (R,)."""
    if not told:
        return {}
    numbers, own = list(told), list(told.values())
    others = log_settings - np.array([one.log_evidence for one in own])  # (O, R)
    log_weights = others - others.max(axis=1, keepdims=True)
    weights = np.exp(np.maximum(log_weights, LEAST_LOG_WEIGHT))
    weights /= weights.sum(axis=1, keepdims=True)
    shares, greatest = zip(*(one.shares for one in own), strict=True)
    likelihood = np.log((weights[:, None] @ np.array(shares))[:, 0]) + np.array(greatest)
    return {
        number: ObjectViews(log_likelihood=likelihood[row], mutual_information=float("nan"), recent=(own[row],))
        for row, number in enumerate(numbers)
    }
