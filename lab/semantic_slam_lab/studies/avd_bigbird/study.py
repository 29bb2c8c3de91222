"""Classes learned on turntables, recognised in a scene in spite of a wrong location (Sec. 3.4.5)."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import Scores
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.configuration import Configuration, PerceptionConfiguration, to_dict
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.crops import square_crop
from semantic_slam.perception.networks.weights import load_network
from semantic_slam.pipeline.provenance import revision
from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.avd_bigbird import figures as draw
from semantic_slam_lab.studies.avd_bigbird.claims import claims, tables
from semantic_slam_lab.studies.avd_bigbird.data import SceneTrack, Sources, choose_track, open_sources
from semantic_slam_lab.studies.avd_bigbird.models import (
    CROP_PX,
    FeatureSets,
    TurntableScores,
    aligned,
    class_processes,
    feature_sets,
    fit_models,
    measure_track,
    measure_turntables,
    single_view_posteriors,
    with_components,
)
from semantic_slam_lab.studies.avd_bigbird.realisations import METHODS, SAMPLES, SIGMA_M, Problem, realisation
from semantic_slam_lab.studies.ch3.metrics import summary, true_class_first
from semantic_slam_lab.studies.result import Figure, write_result

NAME = "avd_bigbird"
NUM_CANDIDATES = 4
REALISATIONS, QUICK_REALISATIONS = 100, 12
BIAS_LENGTH_M = float(np.hypot(0.3, 0.2))
"""Length of the localization bias in the example of Sec. 3.4.5.2."""
BIAS_DIRECTIONS = 16
MAP_HALF_WIDTH_M, MAP_SIZE = 0.6, 61
FIRST_SET = "mean_score"


def run(
    out: Path, *, quick: bool, jobs: int, seed: int, avd: Path | None = None, bigbird: Path | None = None
) -> list[Path]:
    """Fit on turntables, look at the scene, classify and compare; returns the files written. Raises InputError."""
    out.mkdir(parents=True, exist_ok=True)
    sources = open_sources(out / "data", avd, bigbird, seed, quick)
    track = choose_track(sources)
    names = candidates(tuple(sources.turntables), track.class_name, seed)
    true_class = names.index(track.class_name)
    measured = measure_turntables([sources.turntables[name] for name in names], seed, jobs)
    samples = measure_track(sources.scene, track, seed)
    models, sets = fit_models(measured, jobs), feature_sets(measured, seed)
    first = class_processes(with_components(models, sets[FIRST_SET][0]))
    track = aligned(track, samples.mean(axis=1)[..., list(sets[FIRST_SET][0])], first, true_class)
    maps = view_bias_maps(first, samples.mean(axis=1)[..., list(sets[FIRST_SET][0])], track.locations_m)
    bias = worst_bias(maps[..., true_class])
    class_scores = scores_of_classes(samples, names)
    outcome: dict[str, dict[str, Array]] = {}
    unbiased: dict[str, dict[str, Array]] = {}
    for name, (components, _) in sets.items():
        if name != FIRST_SET and components == sets[FIRST_SET][0]:
            outcome[name], unbiased[name] = outcome[FIRST_SET], unbiased[FIRST_SET]
            continue
        scores = [Scores.of(view[:, list(components)]) for view in samples]
        problem = Problem(with_components(models, components), track.locations_m, scores, class_scores, bias)
        outcome[name] = _repeated(problem, quick, seed, jobs, name)
        unbiased[name] = realisation(replace(problem, bias_m=np.zeros(2)), ("ours", "model_based"), (seed, 0))
    result = {
        "study": NAME,
        "seed": seed,
        "config": to_dict(Configuration()),
        "revision": revision(),
        "quick": quick,
        "settings": {
            "simulated": sources.simulated,
            "classes": names,
            "object": track.object_name,
            "heading": "ground truth" if track.heading_known else "the one that explains the views best",
            "views": list(track.images),
            "bias_m": bias.tolist(),
            "sigma_m": SIGMA_M,
            "track_samples": SAMPLES,
            "realisations": len(next(iter(outcome[FIRST_SET].values()))) - 1,
            "scores": list(load_network(PerceptionConfiguration()).class_names),
        },
        **results_of(outcome, unbiased, sets, true_class),
        "wrong_share_of_bias_map": [float((view.argmax(axis=-1) != true_class).mean()) for view in maps],
        "right_without_bias": [bool(view[MAP_SIZE // 2, MAP_SIZE // 2].argmax() == true_class) for view in maps],
    }
    pictures = figures(out, sources, track, measured, models, sets, maps, bias, outcome, true_class)
    return write_result(out, result, claims(result), tables(result), pictures)


def candidates(known: Sequence[str], true_class: str, seed: int) -> tuple[str, ...]:
    """The true class and three others at random, sorted; raises InputError when there are too few."""
    others = sorted(set(known) - {true_class})
    if len(others) < NUM_CANDIDATES - 1:
        raise InputError(f"turntables: only {', '.join(known)}; {NUM_CANDIDATES} objects are needed, add folders")
    drawn = keyed_generator(NAME, "candidates", seed).choice(others, NUM_CANDIDATES - 1, replace=False)
    return tuple(sorted([true_class, *(str(name) for name in drawn)]))


def view_bias_maps(processes: ClassProcesses, scores: Array, track_m: Array) -> Array:
    """(K, n, n, C) single-view posteriors of (K, F) mean scores over the bias of the location, rows along y."""
    axis = np.linspace(-MAP_HALF_WIDTH_M, MAP_HALF_WIDTH_M, MAP_SIZE)
    offsets = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    views = zip(scores, track_m, strict=True)
    flat = [single_view_posteriors(processes, score, place + offsets) for score, place in views]
    return np.stack(flat).reshape(len(track_m), MAP_SIZE, MAP_SIZE, -1)


def worst_bias(true_class_maps: Array) -> Array:
    """(2,) the bias of the given length under which (K, n, n) maps leave the true class least; no method has run."""
    angles = 2.0 * np.pi * np.arange(BIAS_DIRECTIONS) / BIAS_DIRECTIONS
    offsets = BIAS_LENGTH_M * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    cells = np.round((offsets + MAP_HALF_WIDTH_M) / (2.0 * MAP_HALF_WIDTH_M) * (MAP_SIZE - 1)).astype(int)
    left = true_class_maps[:, cells[:, 1], cells[:, 0]].mean(axis=0)
    return np.asarray(offsets[left.argmin()])


def scores_of_classes(samples: Array, names: Sequence[str]) -> tuple[Scores, ...]:
    """A component per candidate, scaled to sum to one, for Simple Bayes; () where the network has no such outputs."""
    known = load_network(PerceptionConfiguration()).class_names
    if not set(names) <= set(known):
        return ()
    chosen = samples[..., [known.index(name) for name in names]]
    return tuple(Scores.of(view / view.sum(axis=-1, keepdims=True)) for view in chosen)


def results_of(
    outcome: dict[str, dict[str, Array]], unbiased: dict[str, dict[str, Array]], sets: FeatureSets, true_class: int
) -> dict[str, Any]:
    """Metrics of both sets of features; realisation 0, the bias alone, is told apart."""
    found: dict[str, Any] = {}
    for name, logs in outcome.items():
        methods: dict[str, Any] = {
            method: summary(true_class_first(values[1:], true_class)) for method, values in logs.items()
        }
        methods["ours"] = {**methods["ours"], "method": "joint", "average": "evidence"}
        alone = {method: np.exp(values[0, :, true_class]).tolist() for method, values in logs.items()}
        components, ranking = sets[name]
        found[name] = {
            "components": components,
            "ranking": ranking.tolist(),
            "methods": methods,
            "p_true_with_bias_alone": alone,
            "p_true_without_bias": {
                method: np.exp(values[:, true_class]).tolist() for method, values in unbiased[name].items()
            },
        }
    return {"methods": found[FIRST_SET]["methods"], "feature_sets": found}


def figures(
    out: Path,
    sources: Sources,
    track: SceneTrack,
    measured: Sequence[TurntableScores],
    models: Sequence[ClassModel],
    sets: FeatureSets,
    maps: Array,
    bias: Array,
    outcome: dict[str, dict[str, Array]],
    true_class: int,
) -> list[Figure]:
    """Figs. 3.14 and 3.16 to 3.18."""
    views = zip(track.images, track.boxes, strict=True)
    crops = [square_crop(sources.scene.image(name), box, CROP_PX) for name, box in views]
    places = np.stack([image.T_map_camera[:2, 3] for image in sources.scene.images.values()])
    rasters = {
        name.replace("_", " "): (chosen, _raster(with_components(models, chosen))) for name, (chosen, _) in sets.items()
    }
    names = load_network(PerceptionConfiguration()).class_names
    files = [
        draw.layout(out / "layout.png", places, track, bias, crops),
        draw.class_models(out / "class_models.png", measured, rasters, names),
        draw.bias_maps(out / "bias_maps.png", maps, MAP_HALF_WIDTH_M, bias, [of.class_name for of in measured]),
    ]
    words = (
        ("Scene and views (Fig. 3.14)", f"The object is a {track.class_name}, at the origin. Views by their number."),
        (
            "Class models (Fig. 3.16)",
            "Mean scores over the direction of view, as rasters; dots are the training views. A row per set of four"
            " scores: the greatest on average, and those that a random forest ranks first. Colours are scores.",
        ),
        (
            "Classification against the bias (Fig. 3.18)",
            "Single views, Model Based: colours are classes. Plus: no bias; white cross: the bias of the estimate.",
        ),
    )
    found = [Figure(title, text, file) for (title, text), file in zip(words, files, strict=True)]
    for name, logs in outcome.items():
        single = {method: values[0] for method, values in logs.items()}
        many = {method: values[1:] for method, values in logs.items() if method in ("ours", "recursive", "model_based")}
        file = draw.track_fans(out / f"fans_{name}.png", single, many, true_class)
        text = "Left: the bias alone. Right: an own offset in every realisation; percentiles 10 to 90."
        found.append(Figure(f"Over the views (Fig. 3.17), features by {name.replace('_', ' ')}", text, file))
    return found


def _repeated(problem: Problem, quick: bool, seed: int, jobs: int, name: str) -> dict[str, Array]:
    """(N + 1, K, C) log posteriors of N realisations and of the bias alone, by method."""
    methods = [method for method in METHODS if method != "simple_bayes" or problem.class_scores]
    count = 1 + (QUICK_REALISATIONS if quick else REALISATIONS)
    done = repeat(realisation, [(problem, methods, (seed, index)) for index in range(count)], jobs, name)
    return {method: np.stack([each[method] for each in done]) for method in methods}


def _raster(models: Sequence[ClassModel]) -> Array:
    """(C, n, n, F) mean scores over a square about the object."""
    axis = np.linspace(-1.25, 1.25, 60)
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    mean = class_processes(models).marginals(places).mean
    return mean.swapaxes(0, 1).reshape(len(models), len(axis), len(axis), -1)
