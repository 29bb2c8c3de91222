"""What has to hold in the statistics of chapter 4, what the thesis says of Fig. 4.5, and what its samples cost."""

from collections.abc import Mapping, Sequence

import numpy as np

from semantic_slam_lab.studies.ch3.pages import number
from semantic_slam_lab.studies.ch4.methods import (
    ALPHAS,
    COLUMNS,
    DEFAULT_ALPHA,
    FIGURE,
    METHODS_OF,
    OURS,
    SAMPLED,
    WITH,
    WITHOUT,
    WORLDS,
    Summaries,
)
from semantic_slam_lab.studies.ch4.runs import Method
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Table

LEAST_P_TRUE = 0.99
LARGEST_OVERCONFIDENCE = 0.05
IMPROVED = ("association_entropy", "det_position_covariance", "error_max_weight_m", "error_weighted_m")
"""The metrics of Fig. 4.5."""


def claims(worlds: Mapping[str, Summaries]) -> list[Claim]:
    """Claims of the chapter-4 study, judged on the results of its worlds."""
    given = worlds["given"]
    return [
        *_requirements(worlds),
        *(_lower(metric, given, WITH, WORLDS["given"]) for metric in IMPROVED),
        _monotone("det_position_covariance", given, ALPHAS),
        _monotone("association_entropy", given, ALPHAS),
        _monotone("association_entropy", given, [alpha for alpha in ALPHAS if alpha <= 0.5]),
        _lower("num_hypotheses", given, WITH, WORLDS["given"]),
        *(_lower(metric, worlds["random"], (OURS,), WORLDS["random"]) for metric in IMPROVED),
        _calibrated(worlds["random"]),
        _samples(worlds),
    ]


def tables(worlds: Mapping[str, Summaries], words: Mapping[str, str]) -> list[Table]:
    """Two tables per world, a row per method in ``words``: averages, and what became of the associations."""
    return [
        Table(
            f"{WORLDS[world].capitalize()}, {methods[OURS.name]['runs']} runs: {title}",
            ("method", *columns.values()),
            tuple((words[name], *(_shown(row[key]) for key in columns)) for name, row in methods.items()),
        )
        for world, methods in worlds.items()
        for title, columns in COLUMNS.items()
    ]


def _requirements(worlds: Mapping[str, Summaries]) -> list[Claim]:
    chosen = {world: [m.name for m in METHODS_OF[world] if m.weights != SAMPLED.weights] for world in worlds}
    lost = {w: sum(worlds[w][name]["runs_lost"] for name in names) for w, names in chosen.items()}
    runs = {w: sum(worlds[w][name]["runs"] for name in names) for w, names in chosen.items()}
    counted = [f"{lost[world]} of {runs[world]} ({world.replace('_', ' ')})" for world in worlds]
    none = Claim(
        "No run loses all its hypotheses, with semantics of any alpha or without",
        REQUIREMENT,
        "0",
        ", ".join(counted),
        not any(lost.values()),
    )
    return [none, *(_certain(WORLDS[world], worlds[world]) for world in ("given", "exact_map"))]


def _certain(title: str, methods: Summaries) -> Claim:
    ours, without = methods[OURS.name], methods[WITHOUT.name]
    return Claim(
        f"At the end the true association is certain with alpha {DEFAULT_ALPHA} ({title})",
        REQUIREMENT,
        f"at least {LEAST_P_TRUE} on average",
        f"{ours['p_true_association_final']:.4f}, least of {ours['runs']} runs"
        f" {ours['p_true_association_least']:.4f}; {ours['truth_lost']} have pruned the truth; mass discarded on the"
        f" way {number(ours['discarded_mass_final'])} on average; without semantics"
        f" {without['p_true_association_final']:.4f}, {without['truth_lost']} have pruned the truth",
        ours["p_true_association_final"] >= LEAST_P_TRUE,
    )


def _lower(metric: str, methods: Summaries, with_semantics: Sequence[Method], title: str) -> Claim:
    without = methods[WITHOUT.name][metric]
    means = [methods[method.name][metric] for method in with_semantics]
    which = "every alpha" if len(means) > 1 else f"alpha {DEFAULT_ALPHA}"
    return Claim(
        f"Semantics lower {_plain(metric)} for {which} ({title})",
        "Sec. 4.4, Fig. 4.5",
        "lower",
        f"{_list(metric, methods, with_semantics)}; without {_shown(without)}",
        bool(all(mean < without for mean in means)),
    )


def _monotone(metric: str, methods: Summaries, alphas: Sequence[float]) -> Claim:
    chosen = [Method(alpha) for alpha in alphas]
    return Claim(
        f"Stronger dependence on the viewpoint helps more: {_plain(metric)}, alpha up to {alphas[-1]:g}",
        "Sec. 4.4, Fig. 4.5",
        "assists more significantly",
        _list(metric, methods, chosen),
        bool(np.all(np.diff([methods[method.name][metric] for method in chosen]) < 0.0)),
    )


def _calibrated(methods: Summaries) -> Claim:
    ours = methods[OURS.name]
    return Claim(
        "Where everything is drawn from the priors, the likeliest association is right as often as it claims",
        "ours",
        "",
        f"claims {number(ours['confidence'])}, right {number(ours['likeliest_is_true'])} (alpha {DEFAULT_ALPHA})",
        ours["likeliest_is_true"] > ours["confidence"] - LARGEST_OVERCONFIDENCE,
    )


def _samples(worlds: Mapping[str, Summaries]) -> Claim:
    lost = {m.name: sum(methods[m.name]["truth_lost"] for methods in worlds.values()) for m in (OURS, SAMPLED)}
    runs = sum(methods[OURS.name]["runs"] for methods in worlds.values())
    return Claim(
        f"The thesis's 1000 samples lose the truth more often than our weights (alpha {DEFAULT_ALPHA}, all worlds)",
        "ours",
        "",
        f"{lost[SAMPLED.name]} against {lost[OURS.name]} of {runs} runs end without the true association",
        lost[SAMPLED.name] > lost[OURS.name],
    )


def _list(metric: str, methods: Summaries, chosen: Sequence[Method]) -> str:
    return ", ".join(f"alpha {method.name}: {_shown(methods[method.name][metric])}" for method in chosen)


def _plain(metric: str) -> str:
    return FIGURE[metric].split(" [")[0]


def _shown(value: float | None) -> str:
    return "–" if value is None else number(value)
