"""What a trained model states of itself: figures on views, and on whole instances, that it was not trained on."""

import numpy as np
from scipy.special import bdtrc

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.fit import TrainedModel, seen_in_rooms, seen_plain
from semantic_slam.training.latent.judging.evaluation import (
    azimuth_peaks,
    descriptors_from_views,
    gradient_ascent,
    identification,
    identification_of_groups,
    local_ascent,
    nees,
    nees_in_doubt,
    one_of_each_direction,
    own_descriptors,
)
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.training.latent.views.turntable_split import TurntableSplit
from semantic_slam.training.latent.views.view_pairs import changes_found

Report = dict[str, dict[str, dict[str, float]]]

LOCAL_RAD = float(np.deg2rad(30.0))
STARTS_DEG = (18.0, 25.0)
ORIENTATION_RAD = float(np.deg2rad(15.0))
VIEWS_OF_HELD_OUT = 3
VIEWS_OF_GROUP = 5
WITHIN_10_DEG = 20.0 / 360.0
"""Share of likelihood peaks that lie within 10 degrees of the true direction wherever they are."""
BY_CHANCE = 0.05
"""Probability from which on what was found may be by chance."""


def training_report(trained: TrainedModel, split: TurntableSplit, seed: int) -> Report:
    """{turntable, rooms}: {views, held_out}: figures; ``held_out`` only where instances were."""
    model, extractor = trained.model, trained.extractor
    names, strangers = model.instances.names, tuple(sorted({view.class_name for view in split.held_out}))
    report: Report = {}
    for place, judged in (("turntable", model.on_turntable()), ("rooms", model)):
        parts = [(split.validate, names)] + ([(split.held_out, strangers)] if strangers else [])
        seen = [
            seen_plain(views, whose, extractor)
            if place == "turntable"
            else seen_in_rooms(views, whose, extractor, seed + 2)
            for views, whose in parts
        ]
        report[place] = {"views": of_known(judged, seen[0], seed)}
        if strangers:
            report[place]["held_out"] = of_held_out(judged, seen[1], seed)
    return report


def of_no_use(report: Report) -> list[str]:
    """Lines on what the model tells no better than by chance, from new plain views of trained instances."""
    figures = report["turntable"]["views"]
    views, instances = figures["views"], figures["objects"]
    told = [
        ("likelihood peak within 10 deg", "peak_within_10deg", WITHIN_10_DEG, "no direction"),
        ("identified from one view", "identification", 1.0 / instances, "no instance from another"),
    ]
    return [
        f"{name}: {figures[key]:.3f} of {views:.0f} new plain views, by chance {chance:.3f}: the model tells {nothing};"
        " give pictures that differ, or more --effort"
        for name, key, chance, nothing in told
        if chance < 1.0 and _probability_of_more(round(figures[key] * views), int(views), chance) > BY_CHANCE
    ]


def _probability_of_more(found: int, count: int, chance: float) -> float:
    """Probability that at least so many of the count are found if each is found by chance."""
    return float(bdtrc(found - 1, count, chance)) if found else 1.0


def of_known(model: LatentModel, views: FeatureViews, seed: int) -> dict[str, float]:
    """Figures on new views of trained instances."""
    generator = np.random.default_rng((seed, 21))
    descriptors = own_descriptors(model, views)
    apart = one_of_each_direction(views, generator)
    own = own_descriptors(model, apart)
    tempered, plain = nees(model, apart, own), nees(model, apart, own, model.noise.sigma)
    return {
        **_of_directions(model, views, descriptors, generator),
        "nees": tempered.nees,
        "nees_low": tempered.band[0],
        "nees_high": tempered.band[1],
        "nees_untempered": plain.nees,
        "within_two_sigma": tempered.within_two_sigma,
        "identification": float(identification(model, views).mean()),
        "identification_5_views": float(
            identification_of_groups(model, views, VIEWS_OF_GROUP, ORIENTATION_RAD, generator).mean()
        ),
        **(changes_found(model.changes, views, generator) if model.changes else {}),
        "objects": float(len(model.instances.names)),
    }


def of_held_out(model: LatentModel, views: FeatureViews, seed: int) -> dict[str, float]:
    """Figures on instances that were never trained on, their descriptors inferred from a few of their views."""
    generator = np.random.default_rng((seed, 22))
    inferred = descriptors_from_views(model, views, VIEWS_OF_HELD_OUT, generator)
    return {
        **_of_directions(model, inferred.views, inferred.descriptors, generator),
        **(changes_found(model.changes, views, generator) if model.changes else {}),
        "nees": nees_in_doubt(model, inferred).nees,
        "nees_of_new": nees_in_doubt(model.on_new_instances(), inferred).nees,
        "nees_descriptor_taken_as_exact": nees(model, inferred.views, inferred.descriptors).nees,
        "objects": float(len(views.names)),
    }


def _of_directions(
    model: LatentModel, views: FeatureViews, descriptors: Array, generator: np.random.Generator
) -> dict[str, float]:
    """Peaks over the azimuth and ascents towards it."""
    peaks = np.abs(azimuth_peaks(model, views, descriptors))
    figures = {
        "views": float(len(views)),
        "peak_within_10deg": float((peaks < np.deg2rad(10.0)).mean()),
        "peak_within_5deg_local": local_ascent(model, views, descriptors, LOCAL_RAD, generator).within(5.0),
    }
    for degrees in STARTS_DEG:
        ascents = gradient_ascent(model, views, descriptors, float(np.deg2rad(degrees)), generator)
        figures[f"improved_from_{degrees:.0f}deg"] = ascents.improved_fraction
        figures[f"median_from_{degrees:.0f}deg_deg"] = ascents.median_error_deg
    return figures
