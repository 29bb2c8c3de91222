"""One long run with and without semantics: posterior over poses and associations (Figs. 4.3a and 4.4)."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.ch3.pages import number
from semantic_slam_lab.studies.ch4.pictures import (
    association_figure,
    disambiguation_figure,
    posterior_figure,
    tracks_figure,
)
from semantic_slam_lab.studies.ch4.runs import Followed, Method, Moment, follow
from semantic_slam_lab.studies.ch4.scenarios import given_scenario, long_path, settings
from semantic_slam_lab.studies.ch4.simulation import Run, simulate
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Figure, Table, write_result

NAME = "ch4_example"
SHOWN = (1, 5, 15, 25)
"""The keyframes k of Fig. 4.4; every study counts them from 1, as the thesis does."""
APART = frozenset({0, 1})
"""O1 and O2, which do not stand in the row."""
METHODS = {"ours": Method(0.25), "no_semantics": Method(None)}
WORDS = {"no_semantics": "without semantics", "ours": "with semantics"}
REPETITIONS, QUICK_REPETITIONS = 20, 2
"""Noise draws of the same track, the first of which is shown."""
CERTAIN = 0.99


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Simulate, run the engine twice, show; returns the files written."""
    count = QUICK_REPETITIONS if quick else REPETITIONS
    arguments = [(name, seed, index) for index in range(count) for name in METHODS]
    found = repeat(followed, arguments, jobs, NAME)
    runs = [{name: found[len(METHODS) * index + n] for n, name in enumerate(METHODS)} for index in range(count)]
    result = summarise(runs, quick, seed)
    out.mkdir(parents=True, exist_ok=True)
    return write_result(out, result, claims(result), tables(result), figures(out, runs[0], seed))


def simulated_run(seed: int, index: int) -> Run:
    """The example's track with noise of its own."""
    scenario, _ = given_scenario()
    return simulate(scenario, long_path(scenario), keyed_generator(NAME, seed, index))


def followed(name: str, seed: int, index: int) -> Followed:
    """One method along one noise draw."""
    return follow(simulated_run(seed, index), METHODS[name], seed)


def summarise(runs: list[dict[str, Followed]], quick: bool, seed: int) -> dict[str, Any]:
    """The shown run keyframe by keyframe, and when each repetition was disambiguated."""
    from semantic_slam.pipeline.provenance import revision

    methods = {name: _method([each[name] for each in runs]) for name in METHODS}
    return {
        "study": NAME,
        "seed": seed,
        "config": {
            "repetitions": len(runs),
            "alpha": METHODS["ours"].alpha,
            "keyframes_shown": SHOWN,
            **{key: value for key, value in settings().items() if key not in ("note", "paths", "alphas")},
        },
        "revision": revision(),
        "quick": quick,
        "methods": {
            "ours": {"method": f"alpha {METHODS['ours'].alpha}, default weights and pruning", **methods["ours"]},
            "no_semantics": methods["no_semantics"],
        },
        "keyframe_apart_seen": [_apart_seen(simulated_run(seed, index)) for index in range(len(runs))],
        "shown": {name: [_keyframe(k, moment) for k, moment in enumerate(runs[0][name].moments)] for name in METHODS},
    }


def _method(found: list[Followed]) -> dict[str, Any]:
    certain = [_from_when(each, lambda moment: moment.p_true_association >= CERTAIN) for each in found]
    single = [_from_when(each, lambda moment: moment.num_hypotheses == 1) for each in found]
    last = [each.moments[-1].p_true_association if not each.fault else 0.0 for each in found]
    return {
        "keyframe_disambiguated": certain,
        "median_keyframe_disambiguated": _median(certain),
        "keyframe_single_component": single,
        "median_keyframe_single_component": _median(single),
        "p_true_association_final": float(np.mean(last)),
        "runs_lost": sum(bool(each.fault) for each in found),
    }


def _apart_seen(simulated: Run) -> int | None:
    """First k at which an object apart from the row is seen."""
    return next((k for k, seen in enumerate(simulated.associations, 1) if APART & set(seen)), None)


def _from_when(found: Followed, settled: Callable[[Moment], bool]) -> int | None:
    """First k from which on a run stays converged; None when it never does."""
    unsettled = [k for k, moment in enumerate(found.moments, 1) if not settled(moment)]
    first = max(unsettled, default=0) + 1
    return first if first <= len(found.moments) and not found.fault else None


def _median(keyframes: list[int | None]) -> float:
    """Never counts as the keyframe after the last."""
    return float(np.median([SHOWN[-1] + 1 if k is None else k for k in keyframes]))


def _keyframe(k: int, moment: Moment) -> dict[str, Any]:
    likeliest = sorted(moment.associations.items(), key=lambda item: (-item[1], item[0]))
    return {
        "k": k + 1,
        "weights": np.exp(moment.log_weights).tolist(),
        "poses": moment.poses.tolist(),
        "pose_covariances": moment.pose_covariances.reshape(len(moment.poses), -1).tolist(),
        "associations": [{"history": history, "probability": p} for history, p in likeliest],
        "p_true_association": moment.p_true_association,
        "association_entropy": moment.association_entropy,
        "component_entropy": moment.component_entropy,
    }


def claims(result: Mapping[str, Any]) -> list[Claim]:
    """What the thesis says of Fig. 4.4."""
    shown, methods = result["shown"], result["methods"]
    apart = _median(result["keyframe_apart_seen"])
    counts = {name: [_count(rows, k) for k in SHOWN] for name, rows in shown.items()}
    text = ", ".join(
        f"k = {k}: {a} against {b}" for k, a, b in zip(SHOWN, counts["ours"], counts["no_semantics"], strict=True)
    )
    return [
        Claim(
            "Semantics leave fewer association histories than geometry alone, until geometry has settled it too",
            "Sec. 4.4, Fig. 4.4 i-l",
            "in all sub-figures",
            text,
            all(a <= b for a, b in zip(counts["ours"], counts["no_semantics"], strict=True))
            and all(a < b for a, b in zip(counts["ours"], counts["no_semantics"], strict=True) if b > 1),
        ),
        Claim(
            "With semantics a single association has significant weight at k = 5",
            "Sec. 4.4, Fig. 4.4 f",
            "one",
            f"largest probability {number(_largest(shown['ours'], 5))},"
            f" without {number(_largest(shown['no_semantics'], 5))}",
            _largest(shown["ours"], 5) > 0.9,
        ),
        Claim(
            "Without semantics the association is settled only when the objects apart from the row are seen",
            "Sec. 4.4, Fig. 4.4 d",
            "k = 25",
            f"P(true association) >= {CERTAIN} from k = {_words(methods['no_semantics'])} on, one of them seen from"
            f" k = {number(apart)} (median); with semantics from k = {_words(methods['ours'])} on",
            methods["ours"]["median_keyframe_disambiguated"]
            < apart
            <= methods["no_semantics"]["median_keyframe_disambiguated"],
        ),
        Claim(
            "With semantics a single component is left earlier",
            "Sec. 4.4, Fig. 4.4",
            "one realization at k = 5, against k = 25",
            f"median k {number(methods['ours']['median_keyframe_single_component'])} against"
            f" {number(methods['no_semantics']['median_keyframe_single_component'])}",
            methods["ours"]["median_keyframe_single_component"]
            < methods["no_semantics"]["median_keyframe_single_component"],
        ),
        Claim(
            "With semantics the true association is certain at the end of the repetitions",
            REQUIREMENT,
            "at least 0.99 on average",
            f"{methods['ours']['p_true_association_final']:.4f}, without"
            f" {methods['no_semantics']['p_true_association_final']:.4f};"
            f" {methods['ours']['runs_lost']} of {result['config']['repetitions']} runs lost",
            methods["ours"]["p_true_association_final"] >= CERTAIN,
        ),
    ]


def _count(rows: list[dict[str, Any]], k: int) -> int:
    return len(rows[k - 1]["associations"]) if k <= len(rows) else 0


def _largest(rows: list[dict[str, Any]], k: int) -> float:
    return float(rows[k - 1]["associations"][0]["probability"]) if k <= len(rows) else 0.0


def _words(method: Mapping[str, Any]) -> str:
    first, median = method["keyframe_disambiguated"][0], method["median_keyframe_disambiguated"]
    return f"{first if first is not None else 'never'} (median of all repetitions {number(median)})"


def tables(result: Mapping[str, Any]) -> list[Table]:
    """The shown run at the keyframes of Fig. 4.4."""
    rows = []
    for name in WORDS:
        for k in SHOWN:
            if k <= len(result["shown"][name]):
                row = result["shown"][name][k - 1]
                values = (row["p_true_association"], row["association_entropy"], row["component_entropy"])
                rows.append((WORDS[name], str(k), str(len(row["weights"])), *(number(value) for value in values)))
    columns = ("", "k", "components", "P(true association)", "H(associations) [nats]", "H(components) [nats]")
    return [Table("The shown run", columns, tuple(rows))]


def figures(out: Path, shown: Mapping[str, Followed], seed: int) -> list[Figure]:
    """Figs. 4.3a and 4.4."""
    simulated = simulated_run(seed, 0)
    moments = {words: shown[name].moments for name, words in WORDS.items()}
    return [
        Figure(
            "The scenario (Fig. 4.3a)",
            "Objects with their headings, all of one class, and the robot's true track; the cross is where the robot"
            " believes to start, give or take 10 m.",
            tracks_figure(out / "scenario.png", simulated.scenario, [simulated]),
        ),
        Figure(
            "Posterior over the newest pose (Fig. 4.4 a-h)",
            "One and two sigma of every component that is kept, bolder for more weight; green: the true track.",
            posterior_figure(out / "posterior.png", simulated, moments, SHOWN),
        ),
        Figure(
            "Posterior over the associations (Fig. 4.4 i-l)",
            "Each number is a history of associations up to k; the green circle marks the true one.",
            association_figure(out / "associations.png", simulated, moments, SHOWN),
        ),
        Figure(
            "From keyframe to keyframe",
            "Components kept, entropy over the associations, and the probability of the true one.",
            disambiguation_figure(out / "disambiguation.png", moments),
        ),
    ]
