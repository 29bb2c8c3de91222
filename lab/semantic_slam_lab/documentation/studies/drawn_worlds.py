"""Worlds drawn from the priors of the robot that nobody calibrated."""

from typing import Any

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "drawn_worlds"


def ranks(results: KeptResults) -> str:
    """Whether the ranks of the truth are even."""
    own = _own(results)
    rows = [(name, value(p, ".2g"), value(name not in own.get("rejected", []))) for name, p in own["p_values"].items()]
    return table(("quantity", "p of even ranks", "even (Holm, 1 %)"), rows)


def stated(results: KeptResults) -> str:
    """What was stated with a probability, and how often it held."""
    rows = [
        (name, value(mean, ".2f"), value(share, ".2f"), str(count), value(credible))
        for name, bins in _own(results)["reliability"].items()
        for mean, share, count, credible in bins
    ]
    return table(("what", "stated, on average", "holds", "worlds", "credible (all bins, 1 %)"), rows)


def regions(results: KeptResults) -> str:
    """Regions where all is as stated, and with one thing apart."""
    own = _own(results)
    rows = [(truth, str(own["num_worlds"][truth]), value(held, ".0%")) for truth, held in own["region95_held"].items()]
    return table(("worlds are drawn", "worlds", "keyframes whose 95 % region holds the position"), rows)


def _own(results: KeptResults) -> dict[str, Any]:
    return results.results[STUDY]


SECTIONS = (
    Section(
        STUDY,
        "Worlds drawn from the priors of the uncalibrated robot",
        "Odometry with biases and a clock that is off, errors that repeat, misses in runs, false alarms, objects: all"
        " as `config/uncalibrated.yaml` takes them to be; 20 keyframes each, one keyframe, object and pair drawn from"
        " each world. Where a belief is right, the truth has even ranks in it, and its 95 % regions hold it in 95 %."
        " Then one thing apart at a time: within what the configuration allows for (noise of twice the sigmas is one of"
        " the levels that it weighs, a yaw bias of 0.1 rad/m two standard deviations of its prior), or what it does"
        " not know of.",
        (
            ("Ranks of the truth", ranks),
            ("Stated and observed", stated),
            ("Regions, as stated and with one thing apart", regions),
        ),
    ),
)
