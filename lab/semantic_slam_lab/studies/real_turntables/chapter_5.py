"""Chapter 5 on photographs: the learned likelihood over azimuth and instance, new objects, grounding."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.training.latent.views.turntable_split import TurntableSplit, choose_held_out, split
from semantic_slam.training.views import ObjectView
from semantic_slam_lab.repetitions import repeat
from semantic_slam_lab.studies.real_turntables import latent_scores
from semantic_slam_lab.studies.real_turntables.grounding import DRAWS, QUICK_DRAWS, classes_of, grounded
from semantic_slam_lab.studies.real_turntables.latent_models import (
    FORMULATIONS,
    QUICK,
    Effort,
    Parts,
    factor_of_new_objects,
    feature_views,
    principal_components,
    trained,
)
from semantic_slam_lab.studies.real_turntables.photographs import Photographs

SHARE_OF_NEW = 6
"""One object in so many is held out."""


def numbers(
    photographs: Photographs, layout: Array, data: Path, *, quick: bool, jobs: int, seed: int
) -> dict[str, dict[str, Any]]:
    """Formulation -> what its model tells."""
    new = choose_held_out(photographs.names, {}, len(photographs.names) // SHARE_OF_NEW, seed)
    parts = split(photographs.views, new)
    arguments = [(name, photographs, layout, parts, new, data, quick, seed) for name in FORMULATIONS]
    return dict(zip(FORMULATIONS, repeat(_of_formulation, arguments, jobs, "latent models"), strict=True))


def _of_formulation(
    formulation: str,
    photographs: Photographs,
    layout: Array,
    views: TurntableSplit,
    new: tuple[str, ...],
    data: Path,
    quick: bool,
    seed: int,
) -> dict[str, Any]:
    train, calibrate, test = (_rows(photographs, own) for own in (views.train, views.calibrate, views.validate))
    known = tuple(name for name in photographs.names if name not in new)
    components = principal_components(layout, train)
    effort = QUICK if quick else Effort()
    parts = Parts(known, train, calibrate)
    model, features = trained(formulation, photographs, components, parts, effort, seed)
    factor = factor_of_new_objects(formulation, photographs, layout, parts, effort, seed)
    model = replace(model, new_factor=factor)
    seen = feature_views(photographs, test, known, features)
    scores = latent_scores.by_object(model, seen, latent_scores.told_by_nearest(photographs, layout, train, test))
    strangers = feature_views(photographs, _rows(photographs, views.held_out), new, features)
    classes = classes_of(data, known)
    tagged = tuple(classes)
    rows = test[np.isin(np.array(photographs.names)[photographs.instance[test]], tagged)]
    draws = QUICK_DRAWS if quick else DRAWS
    in_classes = feature_views(photographs, rows, tagged, features)
    return {
        **latent_scores.of_known(model, seen, scores, seed),
        **latent_scores.of_new(model, strangers, seed),
        "grounding": grounded(model, in_classes, classes, draws, seed),
        "objects": {name: {**vars(own), "can_be_told": own.can_be_told} for name, own in scores.items()},
        "new": list(new),
    }


def _rows(photographs: Photographs, views: Sequence[ObjectView]) -> Index:
    number = {id(view): index for index, view in enumerate(photographs.views)}
    return np.array(sorted(number[id(view)] for view in views))
