"""A cabinet photographed from all around, and things of a kitchen: what Fig. 3.10 shows, in photographs.

Every view is scored by SqueezeNet with dropout, ImageNet's classes in groups; models over the direction of view are
fitted without the stretch that they are tried on. Then the same with the camera taken to be elsewhere.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.classification.metrics import log_mgr
from semantic_slam.evaluation.classification import expected_calibration_error, negative_log_likelihood
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.real_cabinet.methods import METHODS, log_posteriors
from semantic_slam_lab.studies.real_cabinet.network import GROUPS, PASSES, QUICK_PASSES, scores_of, squeezenet
from semantic_slam_lab.studies.real_cabinet.pages import claims_of, figures_of, tables_of
from semantic_slam_lab.studies.real_cabinet.tracks import CLASSES, STRETCHES, Track, tracks_of
from semantic_slam_lab.studies.real_cabinet.views import photographs
from semantic_slam_lab.studies.real_drives.drives import data_folder
from semantic_slam_lab.studies.result import write_result

NAME = "real_cabinet"
OFFSETS_M = {"right": 0.0, "biased": 0.3}
"""Standard deviation of the one offset, along each axis, by which a whole track is taken to be elsewhere."""
REPEATS, QUICK_REPEATS = 20, 1
SETTLED = 0.99
"""Probability of the true class from which on it is settled."""

Posteriors = dict[str, dict[str, list[tuple[Track, Array]]]]
"""Setting -> method -> tracks with their (K, C) log posteriors, every repetition."""


def run(out: Path, *, quick: bool, jobs: int, seed: int, data: Path | None = None) -> list[Path]:
    """Score, fit, classify, compare; returns the files written. One process is enough. Raises InputError."""
    del jobs  # the network takes most of the time
    root = data_folder(data)
    network = squeezenet(root / "weights" / "squeezenet_v1.1.pth")
    views = photographs(root, network.network.input_size, quick=quick)
    tracks = tracks_of(views, scores_of(views, network, QUICK_PASSES if quick else PASSES, seed))
    found = {
        setting: posteriors(tracks, setting, sigma_m, QUICK_REPEATS if quick else REPEATS, seed)
        for setting, sigma_m in OFFSETS_M.items()
    }
    result = summary(found, tracks, quick, seed)
    return write_result(out, result, claims_of(result), tables_of(result), figures_of(out, tracks, OFFSETS_M, seed))


def posteriors(
    tracks: list[Track], setting: str, sigma_m: float, repeats: int, seed: int
) -> dict[str, list[tuple[Track, Array]]]:
    """Every method over every track, with as many offsets as ``repeats`` says where there is one."""
    found: dict[str, list[tuple[Track, Array]]] = {method: [] for method in METHODS}
    for number, track in enumerate(tracks):
        for repeat in range(repeats if sigma_m else 1):
            offset = sigma_m * keyed_generator(NAME, setting, number, repeat, seed).standard_normal(2)
            for method in METHODS:
                generator = keyed_generator(NAME, "samples", setting, number, repeat, seed)
                found[method].append((track, log_posteriors(method, track, offset, sigma_m, generator)))
    return found


def summary(found: Posteriors, tracks: list[Track], quick: bool, seed: int) -> dict[str, Any]:
    """``result.json`` without its claims; the cabinet alone stands at its top."""
    from semantic_slam.pipeline.provenance import revision

    cabinets = {
        setting: {method: _of_cabinet(rows) for method, rows in by_method.items()}
        for setting, by_method in found.items()
    }
    return {
        "study": NAME,
        "seed": seed,
        "config": {"groups": GROUPS, "stretches": STRETCHES, "offsets_m": OFFSETS_M},
        "revision": revision(),
        "quick": quick,
        "num_views": {name: int(sum(len(t.rows) for t in tracks if CLASSES[t.true_class] == name)) for name in CLASSES},
        "num_tracks": len(tracks),
        "methods": _metrics_of(cabinets["right"]),
        "settings": {
            setting: {"cabinet": _metrics_of(cabinets[setting]), "all": _metrics_of(by_method)}
            for setting, by_method in found.items()
        },
    }


def _of_cabinet(rows: list[tuple[Track, Array]]) -> list[tuple[Track, Array]]:
    return [(track, logs) for track, logs in rows if CLASSES[track.true_class] == "cabinet"]


def _metrics_of(by_method: Mapping[str, list[tuple[Track, Array]]]) -> dict[str, dict[str, float | None]]:
    return {method: metrics_of(rows) for method, rows in by_method.items()}


def metrics_of(rows: list[tuple[Track, Array]]) -> dict[str, float | None]:
    """Over the views of all tracks, and at their ends; ``settled_keyframe`` is the mean over tracks that settle."""
    probabilities = np.exp(np.concatenate([logs for _, logs in rows]))
    true = np.concatenate([np.full(len(logs), track.true_class) for track, logs in rows])
    final = [bool(logs[-1].argmax() == track.true_class) for track, logs in rows]
    settled = [view for track, logs in rows if (view := settled_view(np.exp(logs[:, track.true_class]))) is not None]
    ratios = [float(log_mgr(logs, track.true_class)[-1]) for track, logs in rows]
    return {
        "nll": negative_log_likelihood(probabilities, true),
        "ece": expected_calibration_error(probabilities, true),
        "correct_rate_final": float(np.mean(final)),
        "correct_rate_overall": float(np.mean(probabilities.argmax(axis=1) == true)),
        "settled_keyframe": float(np.mean(settled)) if settled else None,
        "settled_share": len(settled) / len(rows),
        "log_mgr_final_p95": float(np.percentile(ratios, 95)),
    }


def settled_view(true_probability: Array) -> int | None:
    """The view from which on the true class's probability (K,) stays at ``SETTLED`` or above; None if it does not."""
    below = np.flatnonzero(true_probability < SETTLED)
    first = int(below[-1]) + 1 if len(below) else 0
    return first if first < len(true_probability) else None
