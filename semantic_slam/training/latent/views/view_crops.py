"""Crops of turntable views: as a detector in a room delivers them, and plain for the targets of the features."""

from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.crops import MARGIN, square_crop
from semantic_slam.training.augmentation import room_crop
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.training.views import ObjectView
from semantic_slam.viewpoint.model import Viewpoints

GREY = 128
"""Grey value of the background behind a plain crop."""


def room_crops(views: Sequence[ObjectView], size: int, draws: int, seed: int) -> Bytes:
    """(draws * N, size, size, 3): all views in random rooms and light, then all of them again; each seeded alone."""
    crops = np.empty((draws * len(views), size, size, 3), dtype=np.uint8)
    for index in tqdm(range(len(crops)), desc="crops in rooms", unit="crop", leave=False):
        crops[index] = room_crop(views[index % len(views)], size, np.random.default_rng((seed, index)))
    return crops


def plain_crops(views: Sequence[ObjectView], size: int) -> Bytes:
    """(N, size, size, 3): the object alone on grey, its box exact."""
    return np.stack([_plain_crop(view, size) for view in views])


def _plain_crop(view: ObjectView, size: int) -> Bytes:
    height, width = view.mask.shape
    border = int(np.ceil(MARGIN * max(height, width))) + 1 + abs(height - width)
    canvas = np.full((height + 2 * border, width + 2 * border, 3), GREY, dtype=np.uint8)
    window = canvas[border : border + height, border : border + width]
    window[view.mask > GREY] = view.cutout[view.mask > GREY]
    box = np.array([border, border, border + width, border + height], dtype=np.float64)
    return square_crop(canvas, box, size)


def feature_views(views: Sequence[ObjectView], names: tuple[str, ...], features: Array) -> FeatureViews:
    """Directions and instances of the views beside their (draws * N, F) features, as ``room_crops`` orders them."""
    draws = len(features) // len(views)
    columns = np.array([(view.azimuth_rad, view.elevation_rad, view.range_m) for view in views])
    azimuth, elevation, range_m = np.tile(columns, (draws, 1)).T
    instance = np.tile([names.index(view.class_name) for view in views], draws)
    return FeatureViews(names, instance, Viewpoints(azimuth, elevation, range_m), features)
