"""Summary of a run's results in plain words."""

import math
from collections.abc import Sequence

import numpy as np

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.evidence.model_fit import UNEXPLAINED
from semantic_slam.inference.hypotheses import RECENT_KEYFRAMES
from semantic_slam.inference.relocation.carried_spans import carried_line
from semantic_slam.maps.from_belief import num_unplaced
from semantic_slam.report.document import Analysis
from semantic_slam.report.shown.objects import CERTAIN, ObjectView
from semantic_slam.report.start import open_tilt
from semantic_slam.report.wording import known, listed, number, percent

NAMED = 4
"""Ambiguous objects that are named one by one."""
NO_ENTROPY = 1e-9
"""Association entropy [nats] below which all hypotheses associate alike."""
MUCH_DISCARDED = 0.05
"""Probability mass discarded in the last keyframes above which the reader is warned."""


def verdict(analysis: Analysis, objects: list[ObjectView]) -> list[str]:
    """Sentences for the head of the report: whether the data are explained, objects, data association, the truth."""
    first = unexplained(analysis.record.beliefs)
    sentences = [
        first,
        _objects(analysis, objects),
        *_ambiguous(analysis, objects),
        _association(analysis),
        *_truth(analysis),
        _wrong_classes(objects),
    ]
    return [sentence for sentence in sentences if sentence]


def warnings(analysis: Analysis, objects: list[ObjectView]) -> list[str]:
    """What a reader must know before trusting the rest."""
    found = [analysis.record.fault] if analysis.record.fault else []
    used = {reason: count for reason, count in analysis.record.dropped.items() if count}
    if used:
        found.append("Dropped: " + ", ".join(f"{count} × {reason}" for reason, count in used.items()) + ".")
    if told := open_tilt(analysis.start, analysis.record.beliefs[-1]):
        found.append(told)
    if carried := analysis.record.carried:
        world = analysis.configuration.get("open_world", {})
        line = carried_line(carried, learns_region=bool(world.get("learn_region")))
        found.append(f"{line[0].upper()}{line[1:]}.")
    if count := num_unplaced(analysis.record.beliefs[-1], analysis.record.run):
        found.append(
            f"{count} object{'s have' if count > 1 else ' has'} no place on the map: the robot has not found out where"
            " it is since it was carried."
        )
    outside = [view.label for view in objects if not view.in_coverage]
    if outside:
        found.append(
            f"More views of object{'s' if len(outside) > 1 else ''} {listed(outside)} lay outside what the class models"
            " were fitted on than false alarms explain; their probabilities deserve less trust."
        )
    mass = analysis.record.beliefs[-1].discarded_mass_window
    if mass > MUCH_DISCARDED:
        found.append(
            f"{percent(mass)} of the probability mass was discarded in the last {RECENT_KEYFRAMES} keyframes;"
            " the stated probabilities are no better than that."
        )
    return found


def unexplained(beliefs: Sequence[HybridBelief]) -> str:
    """Since when, or for how many keyframes, the belief did not explain its data, or this is not known.

    Nothing where it always did, and where no keyframe states it, as in beliefs of older versions.
    """
    lost = [belief.unexplained > UNEXPLAINED for belief in beliefs]
    unknown = [math.isnan(belief.unexplained) for belief in beliefs]
    if not any(lost):
        if all(unknown) or not any(unknown):
            return ""
        return f"In {sum(unknown)} of {len(lost)} keyframes it is not known whether the belief explains its data."
    if not lost[-1]:
        end = "it is not known whether it can" if unknown[-1] else "it can"
        return f"The belief could not explain its data in {sum(lost)} of {len(lost)} keyframes; in the end {end}."
    since = max((place + 1 for place, own in enumerate(lost) if not own), default=0)
    return (
        f"The belief cannot explain its data since keyframe {beliefs[since].keyframe}:"
        " places and probabilities below are not to be trusted."
    )


def _objects(analysis: Analysis, every: list[ObjectView]) -> str:
    objects = [view for view in every if view.exists]
    count, doubtful = len(objects), len(every) - len(objects)
    if not count:
        return "No object was found." if not doubtful else "No object is likely to exist."
    start = "One object is on the map" if count == 1 else f"{count} objects are on the map"
    if doubtful:
        start += f", besides {doubtful} that may not exist"
    if not analysis.record.beliefs[-1].class_names:
        return f"{start}; classes were not estimated."
    whose = _of_how_many(sum(view.certain for view in objects), count)
    return f"{start}; {whose} known with at least {percent(CERTAIN)} certainty."


def _of_how_many(sure: int, count: int) -> str:
    """The subject of "known": of ``count`` objects, the classes of ``sure``; objects' own names are numbers, too."""
    if count == 1:
        return "its class is" if sure else "its class is not"
    if sure == count:
        return "the class of each is"
    return {0: "the class of none is", 1: "the class of one of them is"}.get(sure, f"the classes of {sure} of them are")


def _ambiguous(analysis: Analysis, every: list[ObjectView]) -> list[str]:
    """What is not sure of the objects that are on the map; whether the others exist is asked before what they are."""
    names = analysis.record.beliefs[-1].class_names
    if not names:
        return []
    objects = [view for view in every if view.exists]
    doubtful = sorted(
        (view for view in objects if not view.certain and view.detections), key=lambda view: view.probability
    )
    unseen = [view.number for view in objects if not view.certain and not view.detections]
    never = [number for number in unseen if number not in analysis.seen_by_some]
    sentences = [f"Object {view.label} is ambiguous: {_alternatives(view, names)}." for view in doubtful[:NAMED]]
    if len(doubtful) > NAMED:
        sentences.append(f"{len(doubtful) - NAMED} more are ambiguous.")
    if never:
        sentences.append(f"{'One object was' if len(never) == 1 else f'{len(never)} objects were'} never seen.")
    if others := len(unseen) - len(never):
        sentences.append(
            f"{'One object is' if others == 1 else f'{others} objects are'} of less likely explanations alone."
        )
    return sentences


def _alternatives(view: ObjectView, names: tuple[str, ...]) -> str:
    order = np.argsort(view.probabilities)[::-1][:3]
    likely = [row for row in order if view.probabilities[row] >= 0.05] or list(order[:1])
    return listed([f"{names[row]} {percent(view.probabilities[row])}" for row in likely], "or")


def _association(analysis: Analysis) -> str:
    if analysis.configuration.get("association") == "given":
        return "Which detection shows which object was given with the detections."
    last = analysis.record.beliefs[-1]
    most = max(len(belief.hypothesis_ids) for belief in analysis.record.beliefs)
    explanations = math.exp(last.association_entropy) if math.isfinite(last.association_entropy) else 1.0
    if explanations < 1.02:
        before = f", of up to {most} at a time" if most > 1 else ""
        count = len(last.hypothesis_ids)
        alike = count > 1 and last.association_entropy < NO_ENTROPY
        among = f"; the {count} hypotheses at the end associate alike and differ in classes or modes" if alike else ""
        return f"One explanation of which detection shows which object is left{before}{among}."
    best = float(np.exp(last.log_weights.max()))
    return (
        f"Which detection shows which object is still open: {len(last.hypothesis_ids)} hypotheses remain,"
        f" the best holds {percent(best)} (as uncertain as {explanations:.1f} equal explanations)."
    )


def _truth(analysis: Analysis) -> list[str]:
    if analysis.evaluation is None:
        return []
    metrics = analysis.evaluation.metrics
    sentences = []
    settled, right = metrics["keyframe_disambiguated"], metrics["association_right"]
    if known(right) and analysis.configuration.get("association") != "given":
        when = f"certain from keyframe {settled} on" if settled is not None else "never certain for good"
        sentences.append(
            f"Against the ground truth, {percent(right)} of the detections are assigned rightly;"
            f" the true assignment was {when}."
        )
    error, dead = metrics["ate_m"], metrics["dead_reckoning_ate_m"]
    if known(error):
        beside = f" (dead reckoning from the prior mean: {number(dead)} m)" if known(dead) else ""
        sentences.append(f"The path of the final hypothesis is {number(error)} m (RMS) from the true one{beside}.")
    return sentences


def _wrong_classes(objects: list[ObjectView]) -> str:
    """Which objects on the map are surely taken for another class than their true one."""
    wrong = [view for view in objects if view.exists and view.certain and view.is_wrong]
    if not wrong:
        return ""
    named = listed(
        [f"that of object {view.label} is {view.true_class}, not {view.class_name}" for view in wrong[:NAMED]]
    )
    start = "One class held for known is" if len(wrong) == 1 else f"{len(wrong)} classes held for known are"
    return f"{start} wrong: {named}{', …' if len(wrong) > NAMED else ''}."
