"""E-step of the label-model fit: expected counts of words drawn from the class prior, under the current model.

A new inlier answer is drawn either from the object's earlier words, or from its class prior for that side (Polya's
urn). Only the latter are evidence for the class prior; each is weighted by its probability over settings, classes,
headings, and the hypotheses that the views are of one object.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.training.labels.tracks import Track
from semantic_slam.viewpoint.labels.confusion import HIDDEN_NONE
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import LabelRecord, LabelView, ViewShares
from semantic_slam.viewpoint.labels.views import LaterView


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """Expected sufficient statistics summed over tracks; R settings, S sectors, L labels, W words."""

    drawn: Array  # (R, S, L, W) words drawn from the class prior
    inliers: Array  # (R,) new inlier answers, however drawn
    outliers: Array  # (R,)
    objects: Array  # (R, C) objects of each class
    classes: Array  # (R, C) of them, those that are not mapped, which tell how frequent classes are
    habits: Array  # (R, H) objects with each second-word habit
    log_evidence: Array  # (R,) of the views

    @classmethod
    def nothing(cls, model: LabelModel) -> Self:
        """Sums over no track."""
        count = model.num_settings
        return cls(
            drawn=np.zeros((count, model.num_headings, len(model.labels), model.num_words)),
            inliers=np.zeros(count),
            outliers=np.zeros(count),
            objects=np.zeros((count, len(model.class_names))),
            classes=np.zeros((count, len(model.class_names))),
            habits=np.zeros((count, len(model.habits))),
            log_evidence=np.zeros(count),
        )

    def plus(self, other: "Expectation", weight: float) -> "Expectation":
        """With that of one more track."""
        return Expectation(
            drawn=self.drawn + weight * other.drawn,
            inliers=self.inliers + weight * other.inliers,
            outliers=self.outliers + weight * other.outliers,
            objects=self.objects + weight * other.objects,
            classes=self.classes + weight * other.classes,
            habits=self.habits + weight * other.habits,
            log_evidence=self.log_evidence + weight * other.log_evidence,
        )


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """A track under a model."""

    record: LabelRecord
    log_rows: Array  # (K,) log prior of the rows
    is_mapped: bool
    shares: Sequence[tuple[LabelView, ViewShares]]  # of the views with a word

    @property
    def log_joint(self) -> Array:
        """(R, K) of the views and the row."""
        return np.asarray(self.record.log_likelihood + self.log_rows)

    @property
    def log_evidence(self) -> Array:
        """(R,) of the views."""
        return finite_log_sum_exp(self.log_joint, axis=1)

    @property
    def rows(self) -> Array:
        """(R, K) probability of each row."""
        return np.asarray(np.exp(self.log_joint - self.log_evidence[:, None]))


def replayed(model: LabelModel, track: Track, views: Sequence[LabelView]) -> Replayed:
    """Some views of a track, in their order."""
    record, shares = model.start(), []
    for view in views:
        if view.word.answer < 0:
            record = model.after(record, view)
            continue
        weighed = LaterView.of(model, record, view, model.drawn(view))
        shares.append((view, weighed.shares))
        record = weighed.record
    log_prior = np.log(model.class_shares) if track.log_prior is None else track.log_prior
    return Replayed(
        record=record, log_rows=model.log_rows(log_prior), is_mapped=track.log_prior is not None, shares=shares
    )


def expected(model: LabelModel, told: Replayed, rows: Array) -> Expectation:
    """What the views of one track are expected to be, where its (R, K) rows have these probabilities."""
    found = Expectation.nothing(model)
    drawn, inliers, outliers = found.drawn.copy(), found.inliers.copy(), found.outliers.copy()
    sectors, labels = model.num_headings, len(model.labels)
    headings = np.arange(sectors)
    for view, shares in told.shares:
        drawn_from = np.moveaxis(rows * shares.drawn, 0, -1)  # (R, K, n)
        own = drawn_from[:, :-HIDDEN_NONE].reshape(len(rows), labels, sectors, -1)
        words = np.zeros((len(rows), sectors, labels, model.num_words))
        words[..., [shares.words[place] for place in shares.reported]] = own.transpose(0, 2, 1, 3)
        drawn[:, (model.confusions[-1].sector_of(view.direction) - headings) % sectors] += words
        inliers += (rows * shares.inlier).sum(axis=1)
        outliers += (rows * shares.outlier).sum(axis=1)
    objects = _classes(rows, labels, sectors)
    return Expectation(
        drawn=drawn,
        inliers=inliers,
        outliers=outliers,
        objects=objects,
        classes=found.classes if told.is_mapped else objects,
        habits=objects @ told.record.seconds.habits,
        log_evidence=told.log_evidence,
    )


def _classes(rows: Array, num_labels: int, num_headings: int) -> Array:
    """(R, C) from (R, K) of the rows."""
    own = rows[:, :-HIDDEN_NONE].reshape(len(rows), num_labels, num_headings).sum(axis=2)
    return np.column_stack([own, rows[:, -HIDDEN_NONE:].sum(axis=1)])
