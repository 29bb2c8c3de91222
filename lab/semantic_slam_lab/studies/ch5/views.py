"""Views for chapter 5's studies: of known and of new instances, from directions that no model was trained on."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.training.latent.views.turntable_split import TEST_PERIOD_DEG, VALIDATE_DEG
from semantic_slam.training.latent.views.view_crops import feature_views, plain_crops, room_crops
from semantic_slam.training.views import ObjectView
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam_lab.repetitions import repeat
from semantic_slam_lab.simulation.orbit import orbit_views
from semantic_slam_lab.simulation.turntable import CAMERAS
from semantic_slam_lab.studies.ch5.models import Shipped

RINGS = tuple(camera for camera in CAMERAS if camera.name in ("NP1", "NP3"))
"""A low and a higher ring of the turntable."""
KINDS = ("room", "plain")
"""A detector's crop with the room behind and its light, and the object alone."""


def validation_views(names: Sequence[str], jobs: int, every_deg: int = TEST_PERIOD_DEG) -> list[ObjectView]:
    """Views of catalogue objects from ``RINGS``, halfway between trained directions."""
    angles = np.deg2rad(np.arange(VALIDATE_DEG, 360 + VALIDATE_DEG, every_deg))
    azimuth = np.tile(np.angle(np.exp(1j * angles)), len(RINGS))
    elevation = np.repeat([ring.elevation_rad for ring in RINGS], len(angles))
    range_m = np.repeat([ring.range_m for ring in RINGS], len(angles))
    viewpoints = Viewpoints(azimuth, elevation, range_m)
    found = repeat(rendered, [(name, viewpoints) for name in names], jobs, "rendering views")
    return [view for of_name in found for view in of_name]


def rendered(name: str, viewpoints: Viewpoints) -> list[ObjectView]:
    """All at once, for a process of its own."""
    return list(orbit_views(name, viewpoints))


def measured(trained: Shipped, views: Sequence[ObjectView], kind: str, seed: int) -> FeatureViews:
    """Features of the views under one of ``KINDS``; instances in the order of their first view."""
    size = trained.extractor.input_size
    crops = room_crops(views, size, 1, seed) if kind == "room" else plain_crops(views, size)
    names = tuple(dict.fromkeys(view.class_name for view in views))
    return feature_views(views, names, trained.extractor.features(crops))


def named(views: FeatureViews, names: Sequence[str]) -> FeatureViews:
    """The views of some instances, in the order of ``names``."""
    order = tuple(names)
    rows = np.flatnonzero(np.isin(np.array(views.names)[views.instance], order))
    chosen = views.chosen(rows)
    instance = np.array([order.index(views.names[index]) for index in chosen.instance], dtype=int)
    return FeatureViews(order, instance, chosen.viewpoints, chosen.features)
