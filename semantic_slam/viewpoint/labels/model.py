"""Label likelihood: an object's class from a detector's label words, with the confusions integrated out per object.

An object of class c draws its words from an unknown probability vector theta_c, with a Dirichlet prior. Before the
detector's confusions have been counted, most of the prior counts are on the class's own label and the rest is spread
evenly. Fitted counts are specific to the detector and may depend on the visible side (:class:`Confusion`), with the
object's heading one of several equally likely ones. An object of none of the labels is either called by the "other"
word, or by any label alike. Words are counted sequentially (Polya's urn), for each object separately.

Views are correlated. From the viewpoint of an earlier view the detector repeats that answer with probability rho,
whatever the object is, and otherwise draws a new answer; rho decreases by 1 / e with every ``repeat_rad`` by which the
viewing direction or the log distance differs. Of the new answers a share e are outliers, uniform over the words:

    P(word | c, earlier) = rho [word = that of the nearest earlier view] + (1 - rho) ((1 - e) theta_c(word) + e / W).

Scores q(w) express the confidence of an answer: sum_w theta_c(w) q(w) replaces theta_c(word). They are densities
relative to that of the scores under any class.

The value of rho at the same viewpoint, whether scores add to the word, and the total count of a row (small: each object
is confused in its own way; large: any box may be confused) are discrete settings with prior weights. Their posterior
uses the evidence of all objects, as all share one detector.

Given theta the recursion is exact; given which answers are new and which words they mean, so are the counts. Jointly
it is not: an answer is counted by the probability that it is new and means the word (assumed-density filtering).
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.viewpoint.labels.prior import NONE_OF_THESE as NONE_OF_THESE
from semantic_slam.viewpoint.labels.prior import LabelPrior
from semantic_slam.viewpoint.labels.record import LabelRecord, LabelView
from semantic_slam.viewpoint.labels.views import FirstView, LaterView, SilentView, WeighedView


@dataclass(frozen=True, kw_only=True)
class LabelModel(LabelPrior):
    """Likelihood P(words of an object | class), confusions integrated out; L labels, W = L + 1 words."""

    def weighed(self, record: LabelRecord, view: LabelView, drawn: Array) -> WeighedView:
        """Weigh one more view of an object; ``drawn``: see :meth:`LabelPrior.drawn`."""
        if view.word.answer < 0:
            return SilentView.of(self, record)
        return (LaterView if record.words else FirstView).of(self, record, view, drawn)

    def after(self, record: LabelRecord, view: LabelView) -> LabelRecord:
        """Record with one more view."""
        return self.weighed(record, view, self.drawn(view)).record

    def by_setting(self, record: LabelRecord) -> Array:
        """(R, C) log likelihood of all views per setting and class, marginal over headings and "none" hypotheses."""
        return self.by_class(record.log_likelihood)

    def class_log_likelihood(self, record: LabelRecord) -> Array:
        """(C,) log likelihood of all views, marginalised over the settings by this object's evidence alone."""
        weighted = self.by_setting(record) + self.settings.log_weights[:, None]
        return np.asarray(finite_log_sum_exp(weighted, axis=0))

    def word_probabilities(self, record: LabelRecord, view: LabelView) -> Array:
        """(R, K, W) predictive word probabilities of one more view, regardless of its own answer and scores."""
        nearest = record.newest.nearest(view)
        repeating = self.repeats(nearest)
        counts = self.factors[..., None] * self.prior_of(view)
        counts[..., list(record.words)] += np.moveaxis(record.counts, 0, -1)
        share = self.confusions[view.stretch].outlier_share
        new = (1.0 - share) * counts / counts.sum(axis=2, keepdims=True) + share / self.num_words
        repeated = repeating[..., None] * (np.arange(self.num_words) == nearest.answer)
        return np.asarray(repeated + (1.0 - repeating[..., None]) * new)
