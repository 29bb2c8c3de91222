"""Check of scores: uninformative although the configuration uses them."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.doctor.finding import Finding, error, warning
from semantic_slam.doctor.input_summary import InputSummary

NAME = "scores"
LEAST_SCORES = 20


def check(summary: InputSummary) -> Iterator[Finding]:
    configuration, scores = summary.configuration, summary.detections.scores
    scores = scores[np.isfinite(scores)]
    world = configuration.open_world
    learns = world.learn_scores or world.learn_alarm_scores
    if len(scores) < LEAST_SCORES or not (learns or class_model_kind(configuration.semantic_model).labels is not None):
        return
    name = "open_world.learn_scores" if world.learn_scores else "open_world.learn_alarm_scores"
    user = name if learns else f"semantic_model.kind: {configuration.semantic_model.kind}"
    low, high = float(scores.min()), float(scores.max())
    if low < 0.0 or high > 1.0:
        what = f"scores from {low:.3g} to {high:.3g} are no probabilities, by which {user} goes"
        yield error(NAME, what, "give scores from 0 to 1 (a sigmoid of logits, per cent divided by 100)")
    elif high == 0.0:
        what = f"all {len(scores)} scores are 0, by which {user} goes"
        yield error(NAME, what, "have the detector fill in its scores; NaN where it has none")
    elif low == high and np.isfinite(summary.detections.boxes).any():  # whatever measures places has no scores
        what = f"all {len(scores)} scores are {low:g}, by which {user} goes"
        yield warning(NAME, what, "have the detector fill in its scores; NaN where it has none")
