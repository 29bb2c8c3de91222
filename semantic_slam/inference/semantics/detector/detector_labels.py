"""Detector labels ("words") as class evidence, independent of the objects' headings.

Given the positions of camera and object, and the detector's setting (``LabelModel``: how far its views repeat, whether
scores say more than labels), the labels of one object are independent of everything else. The setting is common to all
objects of a hypothesis, which inform it jointly: with Z_o(r) the sum over classes of the labels of object o under
setting r,

    P(all words) = sum_r P(r) prod_o Z_o(r),    P(c | all words) ~ P(c) sum_r w_r P(words of o | c, r),

w_r ~ P(r) prod of the Z(r) of all other objects. Ratios of the first are the evidence of associations. Labels do not
inform positions. Where boxes give sizes (``SizeModel``), an object's boxes are evidence of its class as its labels are,
and also of the association.
"""

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.inference.models.detector_words import DetectorWords
from semantic_slam.inference.models.spatial.log_range import ANYWHERE, LogRange
from semantic_slam.inference.models.spatial.unmeasured_ranges import UnmeasuredRanges, sizes_by_label
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.detector.label_records import LabelEvidence, NewLabelEvidence, label_evidence_of
from semantic_slam.inference.semantics.detector.new_classes import NewClasses
from semantic_slam.inference.semantics.detector.new_words import BoxModels, BoxWords
from semantic_slam.inference.semantics.detector.reassigned_labels import reassigned_labels
from semantic_slam.inference.semantics.detector.track_links import NO_TRACK, TrackLinks
from semantic_slam.inference.semantics.interface import (
    ClassModels,
    LogPriorOf,
    SemanticEvidence,
    SemanticInput,
    reassociates,
)
from semantic_slam.inference.semantics.view_steps import ViewSteps, view_steps
from semantic_slam.inference.states.lineage import Reassigned
from semantic_slam.inference.states.object_views import ObjectViews, class_posterior
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord
from semantic_slam.viewpoint.size_model import SizeModel

LEAST_LOG_WEIGHT = -700.0
"""Floor [nats] of a setting's weight relative to the likeliest: what no setting explains keeps a finite logarithm."""


class DetectorLabels:
    """Evidence of detector labels; the record of an object is the labels it got so far."""

    def __init__(
        self,
        model: LabelModel,
        sizes: SizeModel | None = None,
        tracks: TrackLinks | None = None,
        *,
        class_counts: float,
        anywhere: LogRange = ANYWHERE,
        keeps_boxes: bool = False,
    ) -> None:
        """``class_counts``: objects per class that the model's class frequencies count as.

        ``anywhere``: prior of the range of a new object seen without one, apart from its size. ``keeps_boxes``: labels
        may later be reassigned to other objects; not where tracks are evidence, too.
        """
        self._model, self._sizes, self._tracks = model, sizes, tracks
        self._new_classes = NewClasses(shares=model.class_shares, counts=class_counts * len(model.class_shares))
        self._log_shares = np.log(model.class_shares)
        self.retells = keeps_boxes and tracks is None
        self._boxes = BoxModels(labels=model, sizes=sizes, anywhere=anywhere, keeps_boxes=self.retells)
        self._spelt: tuple[DetectorWords, Array] | None = None  # cache: newest words, and (D, C) of each

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """From the label model, which the kind of class models must have."""
        assert models.labels is not None
        errors = models.configuration.open_world.track_error_share
        tracks = TrackLinks(errors) if errors > 0.0 else None
        return cls(
            models.labels,
            _size_model(models),
            tracks,
            class_counts=models.configuration.semantic_model.class_counts,
            anywhere=UnmeasuredRanges.of(models.configuration).anywhere,
            keeps_boxes=reassociates(models.configuration),
        )

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Log evidence of each candidate's labels, and the objects' records after it."""
        before, parents = [label_evidence_of(parent) for parent in given.parents], given.candidates.assignments.parents
        news, settings = self._news(given, before), np.array([self._of_all(own) for own in before])  # (P, R)
        after = settings[parents] + np.array([self._gained(own) for own in news]).reshape(settings[parents].shape)
        evidence = finite_log_sum_exp(after, axis=1) - finite_log_sum_exp(settings, axis=1)[parents]
        if self._tracks is not None:
            evidence = evidence + self._of_tracks(self._tracks, given, before)

        def records(rows: Sequence[int]) -> list[dict[int, ObjectViews]]:
            every = [before[parents[row]] | {n: own.evidence for n, own in news[row].items()} for row in rows]
            return [_views(told, after[row]) for told, row in zip(every, rows, strict=True)]

        return SemanticEvidence(
            log_weights=evidence,
            effective_sample_sizes=np.full(len(news), np.nan),
            records=records,
            robot=[None] * len(news),
        )

    def retold(
        self, views: Mapping[int, ObjectViews], changes: Sequence[Reassigned], log_prior_of: LogPriorOf
    ) -> tuple[float, dict[int, ObjectViews]]:
        """Log gain of reassigning the labels of detections by ``changes``, and the records afterwards."""
        before = {number: own.recent[0] for number, own in views.items()}
        after = reassigned_labels(self._boxes, before, changes, log_prior_of, self._log_ratios(views))
        settings, revised = self._of_all(before), self._of_all(after)
        gain = finite_log_sum_exp(revised, axis=0) - finite_log_sum_exp(settings, axis=0)
        return float(gain), _views(after, revised)

    def _log_ratios(self, views: Mapping[int, ObjectViews]) -> Array:
        """(C,) log ratio of the class prior of a new object, beside objects with ``views``, to that before the run."""
        numbers = sorted(views)  # in one order, whoever rebuilt the hypothesis
        told = [views[number].recent[0].log_prior + views[number].log_likelihood for number in numbers]
        known = np.array(told).reshape(len(numbers), len(self._log_shares))
        return self._new_classes.log_ratios(class_posterior(np.zeros(len(self._log_shares)), known))

    def _is_untold(self, log_prior: Array) -> Flags:
        """(M,) whether objects have the default class prior, from their (M, C) priors."""
        return np.asarray((log_prior == self._log_shares).all(axis=1))

    def _of_tracks(self, links: TrackLinks, given: SemanticInput, before: list[dict[int, LabelEvidence]]) -> Array:
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
        self,
        step: Step,
        views: Mapping[int, ObjectViews],
        object_ids: Sequence[int],
        log_prior: Array,
        log_ranges: Array,
        variances: Array,
    ) -> Array:
        """Log evidence of labels pair by pair, each as if first of its object's class: sufficient for ranking."""
        if step.words is None or not len(step.detections):
            return np.zeros((len(step.detections), len(log_prior)))
        if self._spelt is None or self._spelt[0] is not step.words:  # shared by the hypotheses of a keyframe
            spelt = [self._word(step.words, number) for number in range(len(step.detections))]
            self._spelt = step.words, np.array(spelt)
        told = self._spelt[1]  # (D, C)
        every = [views.get(number) for number in object_ids]
        first = np.where(self._is_untold(log_prior)[:, None], self._log_ratios(views), 0.0)  # (M + 1, C)
        known = [first[row] if own is None else own.log_likelihood for row, own in enumerate((*every, None))]
        classes = class_posterior(log_prior, np.array(known))  # (M + 1, C)
        if self._sizes is None or step.words.log_angles is None:
            found = np.log(np.exp(told) @ classes.T)
        else:
            anywhere, count = self._boxes.anywhere, (len(step.detections), 1)
            seen = np.hstack([log_ranges, np.full(count, anywhere.mean)])
            spreads = np.hstack([variances, np.full(count, anywhere.sigma**2)])
            sizes = self._log_sizes(self._sizes, step.words.log_angles[:, None] + seen, spreads, every)
            found = np.log(np.einsum("dc,mc,dmc->dm", np.exp(told), classes, np.exp(sizes)))
        if self._tracks is not None:
            known_tracks = [NO_TRACK if own is None else own.recent[0].track for own in every]
            found = found + self._tracks.log_pairs(step.names, known_tracks)
        return np.asarray(found)

    def log_of_one(self, own: ObjectViews, other: ObjectViews, log_prior: Array) -> float:
        """Log evidence of the labels and sizes of two objects as of one, relative to that as of two."""
        log_born = np.zeros(len(log_prior)) if other.log_ratios is None else other.log_ratios
        likelihoods, sizes = [own.log_likelihood, other.log_likelihood], [own.recent[0].sizes, other.recent[0].sizes]
        together = likelihoods[0] + likelihoods[1] - log_born
        if self._sizes is not None and None not in sizes:
            together = together + self._sizes.log_of_one(*sizes)
        of_one, of_own, of_other, of_none = (
            float(finite_log_sum_exp(log_prior + each, axis=0)) for each in (together, *likelihoods, log_born)
        )
        return of_one - of_own - of_other + of_none

    def _log_sizes(
        self, model: SizeModel, shown: Array, variances: Array, views: Sequence[ObjectViews | None]
    ) -> Array:
        """(D, M + 1, C) log densities of apparent sizes (D, M + 1), as one of each object, and as one of none.

        0 for boxes without a size.
        """
        told = [None if own is None else own.recent[0].sizes for own in (*views, None)]
        known = [own or model.start() for own in told]
        means, spreads = np.array([own.mean for own in known]), np.array([own.variance for own in known])
        is_told = np.isfinite(shown)[..., None]
        sizes = np.where(is_told, shown[..., None], 0.0)
        return np.where(is_told, model.log_densities(means, spreads, sizes, variances[..., None]), 0.0)

    def _word(self, words: DetectorWords, number: int) -> Array:
        """(C,) log probability of one label, averaged over settings."""
        word = LabelWord(answer=int(words.answers[number]), shares=words.shares[number])
        view = LabelView(word=word, direction=0, log_range=0.0)
        first = self._model.weighed(self._model.start(), view, self._model.drawn(view))
        return finite_log_sum_exp(first.by_setting + self._model.settings.log_weights[:, None], axis=0)

    def _news(self, given: SemanticInput, before: list[dict[int, LabelEvidence]]) -> list[dict[int, NewLabelEvidence]]:
        """For each candidate, the updated label evidence of this keyframe's objects."""
        rows, ids = given.candidates.assignments, given.object_ids
        parents = rows.parents.tolist()
        news = [dict[int, NewLabelEvidence]() for _ in parents]
        candidates = list(zip(parents, rows.objects.tolist(), view_steps(given).tolist(), news, strict=True))
        ratios = [self._log_ratios(parent.views) for parent in given.parents]
        untold = self._is_untold(given.log_class_prior).tolist()
        none = np.zeros(len(self._log_shares))
        for number, index in enumerate(given.used.tolist()):
            box = BoxWords(self._boxes, given, index)
            known = dict[tuple[int, ...], NewLabelEvidence]()  # shared between hypotheses
            for parent, object_rows, steps, found in candidates:
                column = object_rows[number]
                if column < 0:
                    continue
                object_id = ids[column]
                last, new = before[parent].get(object_id), found.get(object_id)
                earlier = last if new is None else new.evidence
                is_first = earlier is None and untold[column]
                is_new = earlier is None and object_id in given.new[parent]
                key = (id(earlier), parent if is_first else -1, column, is_new, *steps[number])
                if key not in known:
                    log_ratios = ratios[parent] if is_first else none
                    seen = ViewSteps(*steps[number])
                    known[key] = box.weighed(last, earlier, column, log_ratios, seen, is_new=is_new)
                found[object_id] = known[key]
        return news

    def _of_all(self, told: dict[int, LabelEvidence]) -> Array:
        """(R,) log probability of each setting, joint with all labels of a hypothesis."""
        every = [told[number].log_evidence for number in sorted(told)]  # in one order, whoever rebuilt the hypothesis
        return np.asarray(self._model.settings.log_weights + np.add.reduce(every))

    def _gained(self, news: dict[int, NewLabelEvidence]) -> Array:
        """(R,) log evidence of a keyframe's labels under each setting; 0 without any."""
        gains = [own.gain for own in news.values()]
        return sum(gains[1:], gains[0]) if gains else np.zeros(self._model.num_settings)


def _size_model(models: ClassModels) -> SizeModel | None:
    """The model of sizes; None where sizes are no evidence."""
    assert models.labels is not None
    new, share = models.configuration.new_objects, models.configuration.semantic_model.outlier_share
    if new.sigma_log_view <= 0.0:
        return None
    names, known = models.labels.class_names, sizes_by_label(new)
    return SizeModel.of(names, known, new.sigma_log_size, new.sigma_log_view, share)


def _views(told: dict[int, LabelEvidence], log_settings: Array) -> dict[int, ObjectViews]:
    """The records of all objects, with settings weighed by the other objects' labels; ``log_settings`` (R,)."""
    if not told:
        return {}
    numbers, own = list(told), list(told.values())
    others = log_settings - np.array([one.log_evidence for one in own])  # (O, R)
    log_weights = others - others.max(axis=1, keepdims=True)
    weights = np.exp(np.maximum(log_weights, LEAST_LOG_WEIGHT))
    weights /= weights.sum(axis=1, keepdims=True)
    told_of = [weight @ one.shares for weight, one in zip(weights, own, strict=True)]
    likelihood = np.log(told_of) + np.array([one.log_greatest + one.log_ratios for one in own])
    return {
        number: ObjectViews(
            log_likelihood=likelihood[row],
            mutual_information=float("nan"),
            recent=(own[row],),
            log_ratios=own[row].log_ratios,
        )
        for row, number in enumerate(numbers)
    }
