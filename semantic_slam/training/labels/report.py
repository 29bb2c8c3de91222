"""What was learned of a detector, in numbers and in words."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.judgement import Judgement
from semantic_slam.training.labels.candidates import SCORE_POWERS
from semantic_slam.training.labels.fit import Fitted
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.runner_up import LEAST_WORDS, truth_second

MOST_OTHERS = 3
"""Names that a class is confused with, the most frequent ones, which are told."""
LEAST_TOLD = 0.03
"""Share of a class's views from which a name is worth telling."""
FARTHEST = min(power for power in SCORE_POWERS if power > 0.0), max(SCORE_POWERS)
"""Powers of scores between which no end was tried: the right one may be farther."""
NOT_COMPARED = "; directions are not compared, as the fields of view of the runs differ: state one for all of them"


def report_of(found: Fitted, is_kept: bool, first: Judgement, last: Judgement) -> dict[str, Any]:
    """Numbers of the models that were found, and whether they are kept."""
    whole = found.whole
    settings, weights = whole.model.settings, whole.weights
    confusion = whole.model.confusions[-1]
    counts = confusion.counts.mean(axis=0)
    drawn = np.tensordot(weights, whole.told.drawn, axes=1).sum(axis=(0, 2))
    objects = weights @ whole.told.objects
    means = counts / counts.sum(axis=1, keepdims=True)
    names = [*whole.model.labels, "other"]
    return {
        "is_kept": is_kept,
        "rounds": found.rounds,
        "sides": confusion.num_sectors,
        "held_out": {"before": _numbers(first), "after": _numbers(last)},
        "repeat_share": float(weights @ settings.repeat_shares),
        "repeat_rad": float(weights @ settings.repeat_rads),
        "scores_count": float(weights @ (settings.score_powers > 0.0)),
        "score_power": _likeliest(settings.score_powers, weights),
        **_second_words(whole.model),
        "outlier_share": confusion.outlier_share,
        "classes": {
            label: {
                "objects": float(objects[row]),
                "answers": float(drawn[row]),
                "called": {name: float(share) for name, share in zip(names, means[row], strict=True)},
            }
            for row, label in enumerate(whole.model.labels)
        },
    }


def _second_words(model: LabelModel) -> dict[str, float]:
    """How often the truth is second where the first word is wrong; nothing of words of which no other is left."""
    if model.num_words < LEAST_WORDS:
        return {}
    return {"truth_second": float(model.habits @ truth_second(model.num_words))}


def _likeliest(values: Array, weights: Array) -> float:
    """The value (R,) with the largest sum of weights (R,)."""
    each, number = np.unique(values, return_inverse=True)
    return float(each[np.argmax(np.bincount(number, weights))])


def lines_of(report: Mapping[str, Any]) -> list[str]:
    """The report in a few lines."""
    before, after = report["held_out"]["before"], report["held_out"]["after"]
    judged = (
        f"held-out log evidence {before['log_evidence']:.1f} -> {after['log_evidence']:.1f} nats of"
        f" {after['num_words']} words, their calibration error {before['calibration_error']:.3f} ->"
        f" {after['calibration_error']:.3f}"
    )
    if not report["is_kept"]:
        return [
            f"too little to learn from, so the models are as before any fit: {judged}",
            *detection_lines(report["detection"]),
        ]
    lines = [_line(label, own) for label, own in report["classes"].items() if own["objects"] >= 0.5]
    lines.append(_answers_line(report))
    lines.append(scores_line(report["score_power"]))
    return [*lines, judged, *detection_lines(report["detection"])]


def _answers_line(report: Mapping[str, Any]) -> str:
    """How answers depend on the side, on earlier answers and on outliers, and what second words are worth."""
    how = "from all sides alike" if report["sides"] == 1 else f"by {report['sides']} sides"
    second = (
        f" where the first name is wrong the truth is second in {report['truth_second']:.0%};"
        if "truth_second" in report
        else ""
    )
    return (
        f"{how}; a view from the place of an earlier one repeats its answer with {report['repeat_share']:.2f}; outliers"
        f" {report['outlier_share']:.3f};{second} {report['rounds']} rounds"
    )


def scores_line(power: float) -> str:
    """What the detector's scores are worth."""
    if power == 0.0:
        return "scores tell nothing beyond the first two names"
    if power == 1.0:
        return "scores are probabilities as they are told"
    kind = "surer than right" if power < 1.0 else "less sure than it might be"
    farthest = ", the farthest that was tried" if power in FARTHEST else ""
    return f"scores are probabilities to the power of {power:g}{farthest}: the detector is {kind}"


def detection_lines(own: Mapping[str, Any]) -> list[str]:
    """How often the detector detects, and which runs do not tell it."""
    in_space, count = own["runs_in_space"], own["runs"]
    told = [] if in_space == count else [_detection_line(own)]
    if not in_space:
        return told
    which = "runs" if in_space == count else f"{in_space} of {count} runs"
    return [
        *told,
        f"detected how often: not learned from {which} with state_space: spatial, for which it stays as configured;"
        " open_world.detection_probabilities lets a run infer it",
    ]


def _detection_line(own: Mapping[str, Any]) -> str:
    before, after, by_direction = (own["log_evidence"][name] for name in ("before", "after", "by_direction"))
    sideways = "" if by_direction is None else f", by direction {by_direction:.1f}"
    judged = (
        f"held-out log evidence {before:.1f} -> {after:.1f} nats{sideways}, of {own['looks']} looks at objects in view"
        f"{NOT_COMPARED if by_direction is None else ''}"
    )
    if not own["is_kept"]:
        return f"detected how often: too little to learn from, so it stays as configured: {judged}"
    half_range = own["half_range_m"]
    far = "at any distance" if half_range is None else f"half as often at {half_range:g} m"
    shares = ", ".join(f"{share:g}" for share in own["by_direction"])
    alike = "alike in all directions" if by_direction is not None else "taken to be alike in all directions"
    aside = f"{shares} of that from the right to the left of the field of view" if shares else alike
    return (
        f"detected {own['probability']:.0%} of the time, {far}, {aside}; whether an object can be detected persists"
        f" with {own['persistence']:g} from keyframe to keyframe; {judged}"
    )


def _numbers(own: Judgement) -> dict[str, float]:
    return {
        "log_evidence": own.log_evidence,
        "calibration_error": own.calibration_error,
        "num_words": len(own.answers),
    }


def _line(label: str, own: Mapping[str, Any]) -> str:
    others = sorted(((share, name) for name, share in own["called"].items() if name != label), reverse=True)
    told = [f"{name} {share:.0%}" for share, name in others[:MOST_OTHERS] if share >= LEAST_TOLD]
    rest = f", {', '.join(told)}" if told else ""
    return f"{label}: {own['objects']:.1f} objects, called {label} {own['called'][label]:.0%}{rest}"
