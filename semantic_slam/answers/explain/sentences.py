"""Text summary of an explanation in three sentences."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.answers.explain.explanation import Explanation, HistoryExplained
from semantic_slam.answers.explain.rivals import Rival
from semantic_slam.answers.explain.sightings import Sighting

LITTLE_NATS = 0.25
"""Log likelihood ratio [nats] below which views are said to hardly separate two classes."""
OUTLIER = 0.5
"""Probability above which a view is called an outlier."""


def sentences(explanation: Explanation, own: HistoryExplained) -> list[str]:
    """Sentences on the belief and its rival, on the decisive views, and on their association."""
    return [_belief(explanation, own), _views(explanation, own), _association(explanation, own)]


def _belief(explanation: Explanation, own: HistoryExplained) -> str:
    if explanation.classes is None or own.pair is None:
        return (
            f"{explanation.name} exists with probability {explanation.belief.existence[explanation.row]:.4f};"
            " the run has no class models."
        )
    one, other = (explanation.belief.class_names[cls] for cls in explanation.classes)
    probability = explanation.belief.class_probabilities[explanation.row, explanation.classes[0]]
    begin = f"{explanation.name} is of class {one} with probability {probability:.4f}"
    if not own.pair.is_pruned:
        return f"{begin}; {other} is left with log odds of {own.pair.log_odds:+.2f} nats for {one}."
    at = explanation.run.keyframes[own.pair.until + 1].belief.keyframe
    if not own.pair.was_weighed:
        return f"{begin}; {other} was not weighed in keyframe {at} any more (weights.gate, weights.max_candidates)."
    return f"{begin}; {other} was given up in keyframe {at} at log odds of {own.pair.gone:+.2f} nats for {one}."


def _views(explanation: Explanation, own: HistoryExplained) -> str:
    if not own.views:
        return "It was never seen; what is believed of it is what the map said."
    spread = f"{len(own.views)} views {_directions(own.views)}"
    trust = _trust(own.views)
    alone = explanation.alone(own)
    if explanation.classes is None or not np.isfinite(alone).any():
        return f"It was seen in {spread}: {trust}."
    most = int(np.argmax(np.abs(np.nan_to_num(alone))))
    decisive, little = own.views[most], int((np.abs(alone) < LITTLE_NATS).sum())
    one, other = (explanation.belief.class_names[cls] for cls in explanation.classes)
    return (
        f"Of {spread} the one of keyframe {decisive.keyframe} said most between {one} and {other} ({alone[most]:+.2f}"
        f" nats, from {decisive.degrees} deg at {decisive.range_m:.1f} m), and {little} hardly tell them apart;"
        f" {trust}."
    )


def _trust(views: Sequence[Sighting]) -> str:
    """Phrase on the reliability of the views."""
    strange, last = sum(not view.in_coverage for view in views), views[-1].mutual_information
    phrases = [f"{strange} outside what the class models know"]
    if np.isfinite([view.outlier for view in views]).any():
        phrases.insert(0, f"{sum(view.outlier > OUTLIER for view in views)} judged outliers")
    if np.isfinite(last):
        phrases.append(f"model uncertainty {last:.3f} nats at the last one")
    return ", ".join(phrases)


def _association(explanation: Explanation, own: HistoryExplained) -> str:
    of_it = [rival for rival in own.rivals if rival.taken_id == explanation.object_id]
    of_others = [rival for rival in own.rivals if rival.taken_id != explanation.object_id]
    if not of_it:
        begin = "None of its views might have been of anything else"
        return f"{begin}, but {_of_others(explanation, of_others)}." if of_others else f"{begin}."
    likeliest = max(of_it, key=lambda rival: rival.then)
    last = max(of_it, key=lambda rival: (rival.gone is None, rival.gone or 0, rival.log_odds))
    parts = [
        f"{_count(of_it)} of its views might have been of something else, most of all that of keyframe"
        f" {likeliest.keyframe}, of {explanation.name_of(likeliest.object_id)} with probability"
        f" {likeliest.then:.2f} then,"
        f" {_ended(likeliest)}"
    ]
    if last != likeliest:
        other = explanation.name_of(last.object_id)
        parts.append(f"that of keyframe {last.keyframe} was the last in doubt, for {other}, {_ended(last)}")
    if of_others:
        parts.append(_of_others(explanation, of_others))
    return "; ".join(parts) + "."


def _of_others(explanation: Explanation, found: Sequence[Rival]) -> str:
    """Phrase on detections associated with something else."""
    most = max(found, key=lambda rival: rival.then)
    return (
        f"{_count(found)} taken for something else might have been of it, most of all that of keyframe {most.keyframe},"
        f" {explanation.name_of(most.taken_id)} now, with probability {most.then:.2f} then, {_ended(most)}"
    )


def _count(found: Sequence[Rival]) -> int:
    return len({(rival.keyframe, rival.detection) for rival in found})


def _ended(rival: Rival) -> str:
    """Phrase on how an alternative ended."""
    if rival.gone is None:
        return f"and {rival.now:.4f} now"
    seen = " and ".join(rival.by) or "nothing"
    if not np.isfinite(rival.log_odds):
        return f"given up in keyframe {rival.gone}, when nothing continued it; {seen} {_was(rival)} seen"
    return (
        f"given up in keyframe {rival.gone}, {-rival.log_odds:.1f} nats behind the best, when {seen} {_was(rival)} seen"
    )


def _was(rival: Rival) -> str:
    return "were" if len(rival.by) > 1 else "was"


def _directions(views: Sequence[Sighting]) -> str:
    """Phrase on the range of viewing directions, cut at the widest gap."""
    angles = np.sort(np.mod([view.direction_rad for view in views], 2.0 * np.pi))
    gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
    widest = int(np.argmax(gaps))
    first, last = angles[(widest + 1) % len(angles)], angles[widest]
    first, last = (float(np.rad2deg(value)) for value in (first, last))
    where = "its front" if views[0].from_front else "the x axis of map"
    return f"from {first:.0f} counter-clockwise to {last:.0f} deg of {where}"
