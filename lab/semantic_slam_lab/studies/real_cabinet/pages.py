"""Claims, tables and the picture in the manner of Fig. 3.10."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.geometry.log_space import finite_log_sum_exp
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.real_cabinet.methods import MODEL_BASED, OURS, log_posteriors, single_views
from semantic_slam_lab.studies.real_cabinet.tracks import CLASSES, Track
from semantic_slam_lab.studies.result import Claim, Figure, Table

THESIS = "thesis, Sec. 3.4.4.2"
SETTINGS = {"right": "camera where it is", "biased": "camera taken to be elsewhere"}


def claims_of(result: Mapping[str, Any]) -> list[Claim]:
    """What the thesis shows in rendered pictures, asked of photographs."""
    found = []
    for setting, words in SETTINGS.items():
        for subject in ("cabinet", "all"):
            methods = result["settings"][setting][subject]
            own, other, plain = (methods[name] for name in (OURS, MODEL_BASED, "simple_bayes"))
            where = f"{'the cabinet' if subject == 'cabinet' else 'all objects'}, {words}"
            rates = f"{own['correct_rate_final']:.2f}, {other['correct_rate_final']:.2f}"
            losses = f"{own['nll']:.2f}, {other['nll']:.2f}, {plain['nll']:.2f}"
            ratios = f"{own['log_mgr_final_p95']:.1f}, {other['log_mgr_final_p95']:.1f}"
            found += [
                _claim(f"As often right at the end as Model Based: {where}", rates, _at_least(own, other)),
                _claim(f"Lower loss than Model Based and Simple Bayes: {where}", losses, _is_lowest(own, other, plain)),
                _claim(f"Wrong with less confidence than Model Based: {where}", ratios, _is_calmer(own, other)),
            ]
    return found


def _at_least(own: Mapping[str, float], other: Mapping[str, float]) -> bool:
    return own["correct_rate_final"] >= other["correct_rate_final"]


def _is_lowest(own: Mapping[str, float], *others: Mapping[str, float]) -> bool:
    return all(own["nll"] < other["nll"] for other in others)


def _is_calmer(own: Mapping[str, float], other: Mapping[str, float]) -> bool:
    return own["log_mgr_final_p95"] <= other["log_mgr_final_p95"]


def _claim(text: str, measured: str, holds: bool) -> Claim:
    return Claim(text, THESIS, "", measured, bool(holds))


def tables_of(result: Mapping[str, Any]) -> list[Table]:
    """Every method's metrics, for each setting and subject."""
    return [
        _table(f"{words}: {subject}", result["settings"][setting][subject])
        for setting, words in SETTINGS.items()
        for subject in ("cabinet", "all")
    ]


def _table(title: str, methods: Mapping[str, Mapping[str, float | None]]) -> Table:
    keys = tuple(next(iter(methods.values())))
    rows = tuple((name, *(_cell(row[key]) for key in keys)) for name, row in methods.items())
    return Table(title, ("", *keys), rows)


def _cell(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def figures_of(out: Path, tracks: Sequence[Track], offsets_m: Mapping[str, float], seed: int) -> list[Figure]:
    """One stretch about the cabinet, the camera where it is and elsewhere."""
    chosen = next(track for track in tracks if CLASSES[track.true_class] == "cabinet")
    text = (
        "Upper: the score for cabinets (dots, two deviations of the dropout) and what each class model predicts of it"
    )
    text += " along the stretch. Middle: class probabilities of each view by itself. Lower: of all views so far."
    return [
        Figure("A stretch of the cabinet (as Fig. 3.10)", text, _picture(out / "stretch.png", chosen, offsets_m, seed))
    ]


def _picture(path: Path, track: Track, offsets_m: Mapping[str, float], seed: int) -> Path:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    path.parent.mkdir(parents=True, exist_ok=True)
    picture, axes = pyplot.subplots(3, len(offsets_m), figsize=(10.0, 8.0), layout="constrained", sharex=True)
    for column, (setting, sigma_m) in enumerate(offsets_m.items()):
        offset = np.array([sigma_m, 0.0])
        _draw_scores(axes[0, column], track, offset)
        generator = keyed_generator("real_cabinet", "picture", seed)
        each = single_views(OURS, track, offset, sigma_m, generator)
        alone = np.exp(each - finite_log_sum_exp(each, axis=1)[:, None])
        together = np.exp(log_posteriors(OURS, track, offset, sigma_m, generator))
        for panel, values in ((axes[1, column], alone), (axes[2, column], together)):
            for number, name in enumerate(CLASSES):
                panel.plot(values[:, number], label=name, color=f"C{number}")
            panel.set_ylim(-0.02, 1.02)
        axes[0, column].set_title(SETTINGS[setting])
        axes[2, column].set_xlabel("view")
    axes[1, 0].legend(fontsize="small")
    for row, words in enumerate(("score for cabinets", "P(class | view)", "P(class | views so far)")):
        axes[row, 0].set_ylabel(words)
    picture.savefig(path, dpi=100)
    pyplot.close(picture)
    return path


def _draw_scores(panel: Any, track: Track, offset: Any) -> None:
    views, own = np.arange(len(track.rows)), track.true_class
    panel.errorbar(views, track.means[:, own], 2.0 * np.sqrt(track.covariances[:, own, own]), fmt="k.", capsize=2)
    relative = track.relative_m + offset
    azimuth = np.arctan2(relative[:, 1], relative[:, 0])
    where = Viewpoints(azimuth, np.zeros(len(azimuth)), np.ones(len(azimuth)))
    for number in range(len(CLASSES)):
        predicted = track.model.predict(np.full(len(azimuth), number), where)
        panel.plot(views, predicted.mean[:, own], color=f"C{number}")
