"""What both rendered experiments put on their page and into their result."""

from collections.abc import Mapping
from typing import Any

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.studies.ch3.metrics import summary, true_class_first
from semantic_slam_lab.studies.ch3.pages import COLUMNS, number
from semantic_slam_lab.studies.rendered.methods import METHODS, OURS
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Table

Methods = Mapping[str, Mapping[str, Any]]

ROUNDING = 1e-9
"""Nats; certain and right answers differ by the rounding of their logarithms."""
OTHERS = ("recursive", "model_based", "simple_bayes")
NAMES = {"none": "no test noise", "sigma_n": "test noise sigma_n"}
LEAST_EXCESS = 5.0
"""A 95th percentile of Model Based's log MGR above this leaves something to improve by half."""


def summaries(log_posteriors: Mapping[str, Array], true_class: int) -> dict[str, dict[str, Any]]:
    """Metrics of every method from its (N, K, C) log posteriors; "ours" is "joint" where it is not given."""
    found: dict[str, dict[str, Any]] = {
        name: summary(true_class_first(logs, true_class)) for name, logs in log_posteriors.items()
    }
    ours = {**OURS, **found.pop("ours", found.get("joint", {}))}
    return {"ours": ours, **found}


def methods_table(title: str, methods: Methods, words: Mapping[str, str] | None = None) -> Table:
    """A row per method that ``words`` has."""
    names = words or {name: method.words for name, method in METHODS.items()}
    rows = tuple((names[name], *(number(methods[name][column]) for column in COLUMNS)) for name in names)
    return Table(title, ("method", *COLUMNS.values()), rows)


def lowest_nll(methods: Methods, where: str) -> Claim:
    """Whether ours is the best calibrated one by its negative log likelihood, its own variants aside."""
    values = {name: row["nll"] for name, row in methods.items()}
    told = ", ".join(f"{name.replace('_', ' ')} {number(value)}" for name, value in values.items())
    holds = all(values["ours"] <= values[name] + ROUNDING for name in OTHERS)
    return Claim(f"Ours has the lowest NLL ({where})", REQUIREMENT, "", told, holds)


def rates_kept(methods: Methods, where: str, allowed: float) -> Claim:
    """Whether ours is right as often as Model Based, final and overall, up to ``allowed``."""
    pairs = [
        (methods["ours"][f"correct_rate_{when}"], methods["model_based"][f"correct_rate_{when}"])
        for when in ("final", "overall")
    ]
    told = "; ".join(
        f"{when} {ours:.3f} against {theirs:.3f}"
        for when, (ours, theirs) in zip(("final", "overall"), pairs, strict=True)
    )
    holds = all(ours >= theirs - allowed for ours, theirs in pairs)
    return Claim(
        f"Correct rate no lower than Model Based's by more than {allowed} ({where})", REQUIREMENT, "", told, holds
    )
