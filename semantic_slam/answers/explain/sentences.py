"""Text summary of an explanation: the class, the views, and their association, in a few sentences each."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.answers.explain.explanation import Explanation, HistoryExplained
from semantic_slam.answers.explain.rivals import Rival
from semantic_slam.answers.explain.sightings import Sighting
from semantic_slam.geometry.arrays import Array

LITTLE_NATS = 0.25
"""Log likelihood ratio [nats] below which a view is said to hardly separate two classes."""
OUTLIER = 0.5
"""Probability above which a view is called an outlier."""
WORDS = ("No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine", "Ten")
"""Numbers that begin a sentence."""


def sentences(explanation: Explanation, own: HistoryExplained) -> list[str]:
    """One line each on the class and its rival, on the decisive views, and on their association."""
    return [_belief(explanation, own), _views(explanation, own), _association(explanation, own)]


def _belief(explanation: Explanation, own: HistoryExplained) -> str:
    if explanation.classes is None or own.pair is None:
        existence = explanation.belief.existence[explanation.row]
        return f"{explanation.name} exists with probability {existence:.4f}. The run has no class models."
    one, other = (explanation.belief.class_names[cls] for cls in explanation.classes)
    probability = explanation.belief.class_probabilities[explanation.row, explanation.classes[0]]
    begin = f"{explanation.name} is of class {one} with probability {probability:.4f}."
    if not own.pair.is_pruned:
        which = "the heaviest" if own is explanation.histories[0] else "this"
        return f"{begin} In {which} hypothesis the log odds of {one} against {other} are {own.pair.log_odds:+.2f} nats."
    at = explanation.run.keyframes[own.pair.until + 1].belief.keyframe
    if not own.pair.was_weighed:
        settings = "weights.gate, weights.max_candidates"
        return f"{begin} From keyframe {at} on, class {other} was not considered any more ({settings})."
    return (
        f"{begin} Class {other} was dropped in keyframe {at}, at log odds of {own.pair.gone:+.2f} nats of {one}"
        f" against {other}."
    )


def _views(explanation: Explanation, own: HistoryExplained) -> str:
    if not own.views:
        return "It was never seen: the belief about it is what the map says."
    spread = f"{_count(len(own.views), 'view')}, {_directions(own.views)}."
    alone = explanation.alone(own)
    parts = [spread, _separation(explanation, own.views, alone)] if np.isfinite(alone).any() else [spread]
    return " ".join([*parts, _reliability(explanation, own.views)]).strip()


def _separation(explanation: Explanation, views: Sequence[Sighting], alone: Array) -> str:
    """Sentence on how the views, with ``alone`` [nats] each, separate the two classes."""
    most = int(np.argmax(np.abs(np.nan_to_num(alone))))
    decisive, little = views[most], int((np.abs(alone) < LITTLE_NATS).sum())
    assert explanation.classes is not None
    one, other = (explanation.belief.class_names[cls] for cls in explanation.classes)
    rest = f"; {_count(little, 'view').lower()} hardly separate{'s' if little == 1 else ''} them" if little else ""
    return (
        f"The view of keyframe {decisive.keyframe} separates {one} from {other} most ({alone[most]:+.2f} nats, from"
        f" {decisive.degrees} deg at {decisive.range_m:.1f} m){rest}."
    )


def _reliability(explanation: Explanation, views: Sequence[Sighting]) -> str:
    """Sentences on the reliability of the views; "" for a run without class models."""
    if explanation.classes is None:
        return ""
    strange, last = sum(not view.in_coverage for view in views), views[-1].mutual_information
    outliers = sum(view.outlier > OUTLIER for view in views)
    outside = f"{'are' if strange > 1 else 'is'} outside what the class models know"
    if np.isfinite([view.outlier for view in views]).any():
        judged = "are judged outliers" if outliers > 1 else "is judged an outlier"
        number = _number(strange).lower() if strange else "none"
        text = f"{_count(outliers, 'view')} {judged}, and {number} {outside}."
    else:
        text = f"{_count(strange, 'view')} {outside}."
    if np.isfinite(last):
        text += f" The model uncertainty at the last view is {last:.3f} nats."
    return text


def _association(explanation: Explanation, own: HistoryExplained) -> str:
    of_it = [rival for rival in own.rivals if rival.taken_id == explanation.object_id]
    of_others = [rival for rival in own.rivals if rival.taken_id != explanation.object_id]
    unambiguous = ["All its views are unambiguous."] if own.views else []
    parts = _of_it(explanation, of_it) if of_it else unambiguous
    return " ".join([*parts, _of_others(explanation, of_others)] if of_others else parts)


def _of_it(explanation: Explanation, found: Sequence[Rival]) -> list[str]:
    """Sentences on views of the object that could have been of something else."""
    likeliest = max(found, key=lambda rival: rival.then)
    last = max(found, key=lambda rival: (rival.gone is None, rival.gone or 0, rival.log_odds))
    parts = [
        f"{_count(_detections(found), 'view')} could have been of something else; the most likely alternative is"
        f" {explanation.name_of(likeliest.object_id)} in keyframe {likeliest.keyframe}: {_course(likeliest)}."
    ]
    if last != likeliest:
        other = explanation.name_of(last.object_id)
        parts.append(f"The alternative that lasted longest is {other} in keyframe {last.keyframe}: {_course(last)}.")
    return parts


def _of_others(explanation: Explanation, found: Sequence[Rival]) -> str:
    """Sentence on detections that the history assigns otherwise, and that could have been of the object."""
    most = max(found, key=lambda rival: rival.then)
    number, are_objects = _detections(found), all(rival.taken_id >= 0 for rival in found)
    whose = "otherwise" if not are_objects else "to other objects" if number > 1 else "to another object"
    return (
        f"{_count(number, 'detection')} assigned {whose} could have been it; the most likely is that of keyframe"
        f" {most.keyframe} (now {explanation.name_of(most.taken_id)}): {_course(most)}."
    )


def _detections(found: Sequence[Rival]) -> int:
    return len({(rival.keyframe, rival.detection) for rival in found})


def _course(rival: Rival) -> str:
    """Phrase on the probability of an alternative, and on how it ended."""
    then = f"probability {rival.then:.2f} then"
    if rival.gone is None:
        return f"{then}, {rival.now:.4f} now"
    if not np.isfinite(rival.log_odds):
        return f"{then}, dropped in keyframe {rival.gone}, where nothing continued it"
    return f"{then}, dropped in keyframe {rival.gone}, {-rival.log_odds:.1f} nats behind the best"


def _count(number: int, noun: str) -> str:
    """``Three views``, which may begin a sentence; larger numbers in digits."""
    return f"{_number(number)} {noun}{'s' if number > 1 else ''}"


def _number(number: int) -> str:
    return WORDS[number] if number < len(WORDS) else str(number)


def _directions(views: Sequence[Sighting]) -> str:
    """Phrase on the range of viewing directions, cut at the widest gap."""
    angles = np.sort(np.mod([view.direction_rad for view in views], 2.0 * np.pi))
    gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
    widest = int(np.argmax(gaps))
    first, last = angles[(widest + 1) % len(angles)], angles[widest]
    first, last = (float(np.rad2deg(value)) for value in (first, last))
    origin = "its front" if views[0].from_front else "the x axis of map"
    if len(views) == 1:
        return f"from {first:.0f} deg off {origin}"
    return f"from {first:.0f} counter-clockwise to {last:.0f} deg off {origin}"
