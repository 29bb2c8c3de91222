"""What a detector's words tell of an object's class, with its confusions integrated out for each object.

An object of class c is called by a row of probabilities theta_c over words, which nobody knows: Dirichlet. Before
anybody has counted what the detector confuses, most of the counts are on the class's own label and the rest is spread
evenly. Fitted ones are the detector's, and may depend on the side that is seen (:class:`Confusion`), with the object's
heading one of several that are as likely. An object that none of the labels means is either called otherwise, too, or
by any label alike. Words count one after the other (Polya's urn), for each object by itself.

Views repeat themselves. From the place of an earlier view the detector repeats that answer with a probability rho,
whatever the object is, and else answers anew; rho decreases by 1 / e with every ``repeat_rad`` by which the direction
of view or the logarithm of the distance differ. Of the answers that are new a share e are outliers, any word alike:

    P(word | c, earlier) = rho [word = that of the nearest earlier view] + (1 - rho) ((1 - e) theta_c(word) + e / W).

Scores say how sure an answer is: q(w), in place of [w = word], in sum_w theta_c(w) q(w). They are densities relative to
that of scores under any class.

How large rho is from the same place, whether scores tell more than the word, and how many counts a row has (few: each
object is confused in a way of its own; many: any box may be confused) is decided by evidence, in settings that have
weights before the first view: by that of all objects, for the detector is one.

Given theta the recursion is exact, and given which answers are new and what they mean so are the counts. Together they
are not: an answer counts by the probability that it is new and means the word (assumed-density filtering).
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
    """P(words of an object | class), the confusion of its class integrated out; L labels, W = L + 1 words."""

    def weighed(self, record: LabelRecord, view: LabelView, drawn: Array) -> WeighedView:
        """One more view of an object; ``drawn``: see :meth:`LabelPrior.drawn`."""
        if view.word.answer < 0:
            return SilentView.of(self, record)
        return (LaterView if record.words else FirstView).of(self, record, view, drawn)

    def after(self, record: LabelRecord, view: LabelView) -> LabelRecord:
        """With one more view."""
        return self.weighed(record, view, self.drawn(view)).record

    def by_setting(self, record: LabelRecord) -> Array:
        """(R, C) log likelihood of all views under each setting, over headings and what none of these may be."""
        return self.by_class(record.log_likelihood)

    def class_log_likelihood(self, record: LabelRecord) -> Array:
        """(C,) log likelihood of all views, where nothing else tells which setting is right."""
        weighted = self.by_setting(record) + self.settings.log_weights[:, None]
        return np.asarray(finite_log_sum_exp(weighted, axis=0))

    def word_probabilities(self, record: LabelRecord, view: LabelView) -> Array:
        """(R, K, W) of what one more view may be called; its own answer and scores do not matter."""
        repeating, earlier = self.repeats(record, record.nearest(view))
        counts = self.factors[..., None] * self.prior_of(view)
        counts[..., list(record.words)] += np.moveaxis(record.counts, 0, -1)
        share = self.confusions[view.stretch].outlier_share
        new = (1.0 - share) * counts / counts.sum(axis=2, keepdims=True) + share / self.num_words
        repeated = repeating[..., None] * (np.arange(self.num_words) == earlier)
        return np.asarray(repeated + (1.0 - repeating[..., None]) * new)
