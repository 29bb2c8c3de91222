"""The learned likelihood over pose and descriptor (Figs. 5.3, 5.7, 5.8), and what it tells in unseen views."""

from pathlib import Path

import numpy as np

from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.judging import evaluation
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.training.latent.views.view_pairs import changes_found
from semantic_slam.training.views import ObjectView
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.ch5.models import (
    DEFAULT,
    FORMULATIONS,
    WORDS,
    Shipped,
    chosen_goods,
    known,
    new,
    trained,
)
from semantic_slam_lab.studies.ch5.pages import framed
from semantic_slam_lab.studies.ch5.rasters import raster_figure
from semantic_slam_lab.studies.ch5.views import measured, named, validation_views
from semantic_slam_lab.studies.result import Claim, Figure, Table, write_result

NAME = "ch5_likelihood"
QUICK_INSTANCES = 16
LOCAL_RAD = np.deg2rad(30.0)
GROUP, GROUP_SIGMA_RAD = 5, np.deg2rad(10.0)
VIEWS_OF_NEW = 3
SHOWN_VIEW = 4


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render, measure, evaluate every model; returns the files written."""
    out.mkdir(parents=True, exist_ok=True)
    names = chosen_goods(QUICK_INSTANCES if quick else None)
    views = validation_views(names, jobs)
    models = {name: trained(name) for name in (*FORMULATIONS, DEFAULT)}
    numbers = {name: evaluated(model, views, model.crops, seed) for name, model in models.items()}
    config = {"instances": len(names), "views": len(views), "largest_start_deg": float(np.rad2deg(LOCAL_RAD))}
    result = framed(NAME, numbers, config, quick=quick, seed=seed)
    result["summary"] = {**numbers[DEFAULT], "turntable": numbers["map"]}
    rows = {f"{WORDS[name]} ({models[name].crops} crops)": row for name, row in numbers.items()}
    figures = [_rasters(out, name, model, views, seed) for name, model in models.items()]
    return write_result(out, result, claims(numbers), [_table(rows)], figures)


def evaluated(trained_model: Shipped, views: list[ObjectView], kind: str, seed: int) -> dict[str, float]:
    """Every number of a model on the crops of one kind."""
    model, names = trained_model.model, tuple(dict.fromkeys(view.class_name for view in views))
    seen = measured(trained_model, views, kind, seed)
    of_known = named(seen, known(trained_model, names))
    return {**_of_known(model, of_known, seed), **_of_new(model, named(seen, new(trained_model, names)), seed)}


def _of_known(model: LatentModel, own: FeatureViews, seed: int) -> dict[str, float]:
    descriptors = evaluation.own_descriptors(model, own)
    peaks = np.abs(evaluation.azimuth_peaks(model, own, descriptors))
    local = evaluation.local_ascent(model, own, descriptors, LOCAL_RAD, keyed_generator(NAME, "local", seed))
    groups = evaluation.identification_of_groups(
        model, own, GROUP, GROUP_SIGMA_RAD, keyed_generator(NAME, "groups", seed)
    )
    tempered = evaluation.nees(model, own, descriptors)
    untempered = evaluation.nees(model, own, descriptors, model.noise.sigma)
    return {
        "peak_within_10deg": float((peaks < np.deg2rad(10.0)).mean()),
        "peak_within_5deg_local": local.within(5.0),
        "instance_identification": float(evaluation.identification(model, own).mean()),
        "instance_identification_5_views": float(groups.mean()),
        "nees": tempered.nees,
        "nees_band_low": tempered.band[0],
        "nees_band_high": tempered.band[1],
        "nees_untempered": untempered.nees,
        "within_two_sigma": tempered.within_two_sigma,
        "within_two_sigma_untempered": untempered.within_two_sigma,
        **_of_changes(model, own, "", seed),
        "known_instances": float(len(model.instances.names)),
    }


def _of_new(model: LatentModel, views: FeatureViews, seed: int) -> dict[str, float]:
    """Numbers for instances that were held out, their descriptors inferred from three views."""
    inferred = evaluation.descriptors_from_views(model, views, VIEWS_OF_NEW, keyed_generator(NAME, "new", seed))
    peaks = np.abs(evaluation.azimuth_peaks(model, inferred.views, inferred.descriptors))
    local = evaluation.local_ascent(
        model, inferred.views, inferred.descriptors, LOCAL_RAD, keyed_generator(NAME, "new local", seed)
    )
    return {
        "new_instances_peak_within_10deg": float((peaks < np.deg2rad(10.0)).mean()),
        "new_instances_peak_within_5deg_local": local.within(5.0),
        **_of_changes(model, views, "new_instances_", seed),
        "new_instances_nees": evaluation.nees_in_doubt(model, inferred).nees,
        "new_instances_nees_tempered_by_others": evaluation.nees_tempered_by_others(model, inferred).nees,
        "new_instances_nees_descriptor_exact": evaluation.nees(model, inferred.views, inferred.descriptors).nees,
    }


def _of_changes(model: LatentModel, views: FeatureViews, prefix: str, seed: int) -> dict[str, float]:
    """Numbers for the model that tells changes of viewpoint from two views alone (Sec. 5.1)."""
    assert model.changes is not None, "shipped models have one"
    found = changes_found(model.changes, views, keyed_generator(NAME, f"{prefix}changes", seed))
    return {prefix + name: share for name, share in found.items()}


def claims(numbers: dict[str, dict[str, float]]) -> list[Claim]:
    """The project's own aims; the thesis has pictures and no numbers."""
    of_map, of_energy = numbers["map"], numbers["energy"]
    parts = [
        ("MAP: peak over azimuth within 10° in 90 % of unseen views", of_map["peak_within_10deg"], 0.9),
        ("Energy: peak over azimuth within 10° in 84 %", of_energy["peak_within_10deg"], 0.84),
        ("MAP: within 5° when started within 30°, in 95 %", of_map["peak_within_5deg_local"], 0.95),
        ("Energy: within 5° when started within 30°, in 95 %", of_energy["peak_within_5deg_local"], 0.95),
        ("New instances, descriptor from 3 views: peak in 70 %", of_map["new_instances_peak_within_10deg"], 0.7),
        ("MAP: which instance, from one view of known direction, 95 %", of_map["instance_identification"], 0.95),
        (
            "MAP: which instance, from 5 views under an uncertain pose, 95 %",
            of_map["instance_identification_5_views"],
            0.95,
        ),
    ]
    own = [Claim(text, "project", "", f"{value:.3f}", value >= least) for text, value, least in parts]
    for name, row in numbers.items():
        inside = row["nees_band_low"] <= row["nees"] <= row["nees_band_high"]
        text = f"{WORDS[name].capitalize()}: the tempered likelihood's azimuth errors are as large as it says (NEES)"
        told = (
            f"{row['nees']:.2f} in [{row['nees_band_low']:.2f}, {row['nees_band_high']:.2f}];"
            f" untempered {row['nees_untempered']:.2f}"
        )
        own.append(Claim(text, "project", "", told, inside))
    better = of_energy["peak_within_5deg_local"] >= of_map["peak_within_5deg_local"]
    told = f"{of_energy['peak_within_5deg_local']:.3f} against {of_map['peak_within_5deg_local']:.3f}"
    own.append(Claim("Energy minimisation shapes a likelihood better suited to ascent", "Sec. 5.E", "", told, better))
    return own


COLUMNS = {
    "peak_within_10deg": "peak within 10°",
    "peak_within_5deg_local": "within 5° from within 30°",
    "instance_identification": "instance, 1 view",
    "instance_identification_5_views": "5 views, pose uncertain",
    "new_instances_peak_within_10deg": "new instances: peak",
    "new_instances_peak_within_5deg_local": "local",
    "change_peak_within_10deg_near": "change of view up to 45° from two views: peak",
    "change_peak_within_10deg": "all around",
    "new_instances_change_peak_within_10deg_near": "new instances, up to 45°",
    "new_instances_change_peak_within_10deg": "all around",
    "nees": "NEES",
    "nees_untempered": "untempered",
    "within_two_sigma": "within 2 sigma",
    "within_two_sigma_untempered": "untempered",
    "new_instances_nees": "new instances: NEES",
    "new_instances_nees_descriptor_exact": "descriptor taken as exact",
    "new_instances_nees_tempered_by_others": "sigma widened by other new ones",
}


def _table(rows: dict[str, dict[str, float]]) -> Table:
    shown = tuple((label, *(f"{row[column]:.3g}" for column in COLUMNS)) for label, row in rows.items())
    return Table("Unseen views", ("model", *COLUMNS.values()), shown)


def _rasters(out: Path, name: str, model: Shipped, views: list[ObjectView], seed: int) -> Figure:
    """About one view of the first instance that the model knows."""
    first = known(model, tuple(dict.fromkeys(view.class_name for view in views)))[0]
    seen = measured(model, [view for view in views if view.class_name == first], model.crops, seed)
    view = seen.chosen(np.array([SHOWN_VIEW]))
    file = raster_figure(
        out / f"rasters_{name}.png", model.model, view, evaluation.own_descriptors(model.model, view)[0]
    )
    text = (
        f"Log-likelihood of one unseen view of {first} about its true pose and descriptor (circle in the middle; the"
        " cross is the largest value): camera position in the plane, azimuth and elevation, pairs of descriptor axes."
    )
    return Figure(f"Likelihood rasters, {WORDS[name]}", text, file)
