"""Claims and tables of the study of a user's own detector."""

from collections.abc import Callable
from typing import Any

from semantic_slam_lab.studies.own_detector.lessons import FITTED, TAUGHT
from semantic_slam_lab.studies.own_detector.scores import LEAST_LEAD, LEAST_VIEWS, METRICS, SURE
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Table

MOST_ECE = 0.05
MOST_NLL, MOST_ABOVE_TAUGHT, MOST_LATER = 0.5, 1.2, 2.0
OURS, OTHERS = "ours", ("labels_counted", "arg_max", "running_product")
TITLES = {
    "by chance": "Confused by chance",
    "by view": "Confused by view",
    "by side": "Confused by side",
    "torn boxes": "Confused by chance, boxes doubled, split and merged",
}
WORDS = {
    "ours": "`detector`, nothing trained",
    "gp_independent": "`gp_independent`, models from turntables, pixels in place of labels",
    "fitted": "`detector` after `fit --from-run` on bags of other rooms",
    "taught": "`detector`, models from the true classes of those bags",
    "labels_counted": "labels counted",
    "arg_max": "most frequent label",
    "running_product": "running product of scores",
}


def claims_of(result: dict[str, Any]) -> list[Claim]:
    """Names, ghosts, calibration, baselines; on every line, what was asked for on the first."""
    return [claim for line, own in result["lines"].items() for claim in _claims_of_line(line, own)]


def _claims_of_line(line: str, own: dict[str, Any]) -> list[Claim]:
    ours = own["methods"][OURS]

    def claim(text: str, measured: str, holds: bool) -> Claim:
        return Claim(f"{TITLES[line]}: {text}", REQUIREMENT, "", measured, holds)

    return [
        claim(
            "every object exists and has its right name",
            f"{own['right']} of {own['objects']} objects, {own['bags_all_right']} of {own['bags']} bags",
            own["right"] == own["objects"],
        ),
        claim(
            "no other object is likelier than not",
            f"{own['others']} in {own['bags_with_others']} of {own['bags']} bags",
            own["others"] == 0,
        ),
        claim(
            f"P at least {SURE} of the true class where labels carry it ({LEAST_VIEWS} views or more, the true label"
            f" {LEAST_LEAD:.0f} times as often as any other)",
            f"{own['carried_sure']} of {own['carried']} objects",
            own["carried_sure"] == own["carried"],
        ),
        claim(f"ECE at most {MOST_ECE} at the end", f"{ours['ece']:.3f}", ours["ece"] <= MOST_ECE),
        *_claims_of_fits(claim, own["methods"]),
        *(_better(claim, own, metric, when) for metric, when in (("nll", "at the end"), ("nll_online", "on the way"))),
    ]


def _claims_of_fits(claim: Callable[[str, str, bool], Claim], methods: dict[str, Any]) -> list[Claim]:
    """What other bags have taught, where they were asked."""
    if FITTED not in methods:
        return []
    ours, fitted, taught = (methods[name] for name in (OURS, FITTED, TAUGHT))
    after = [own["settled_keyframe"] for own in (fitted, taught)]
    return [
        claim(
            f"NLL at most {MOST_NLL:.0%} of that out of the box after `fit --from-run` on one bag of each other room",
            f"{fitted['nll']:.4f}, {ours['nll']:.4f}",
            fitted["nll"] <= MOST_NLL * ours["nll"],
        ),
        claim(
            f"NLL at most {MOST_ABOVE_TAUGHT:.0%} of that of models from the true classes of those bags",
            f"{fitted['nll']:.4f}, {taught['nll']:.4f}",
            fitted["nll"] <= MOST_ABOVE_TAUGHT * taught["nll"],
        ),
        claim(
            f"settled at most {MOST_LATER:.0f} times as late as by those",
            f"{after[0]:.1f}, {after[1]:.1f} keyframes",
            after[0] <= MOST_LATER * after[1],
        ),
    ]


def _better(claim: Callable[[str, str, bool], Claim], own: dict[str, Any], metric: str, when: str) -> Claim:
    """NLL below that of every rule."""
    values = {name: own["methods"][name][metric] for name in (OURS, *OTHERS)}
    told = ", ".join(f"{WORDS[name]} {values[name]:.3f}" for name in OTHERS)
    holds = all(values[OURS] < values[name] for name in OTHERS)
    return claim(f"better NLL {when} than what people do with labels", f"{values[OURS]:.3f}; {told}", holds)


def tables_of(result: dict[str, Any]) -> list[Table]:
    """One table for each line."""
    columns = ("method", *METRICS.values())
    return [
        Table(
            f"{TITLES[line]}: {own['objects']} objects of {own['bags']} bags",
            columns,
            tuple((WORDS.get(name, name), *_cells(values)) for name, values in own["methods"].items()),
        )
        for line, own in result["lines"].items()
    ]


def _cells(values: dict[str, float]) -> tuple[str, ...]:
    return tuple(
        f"{values[name]:.0%}" if name in ("correct_rate_final", "settled_share") else f"{values[name]:.3g}"
        for name in METRICS
    )
