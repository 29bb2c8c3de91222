"""Views of objects from turntables: folders in BigBIRD's format, and photographs that tell their direction."""

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
from tqdm import tqdm

from semantic_slam.datasets.bigbird import object_folders, turntable_views
from semantic_slam.datasets.turntables.photographs import Photograph
from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.training.views import ObjectView, cut_out


def load_views(
    root: Path, cameras: Sequence[str], wanted: Callable[[int], bool] = lambda angle_deg: True
) -> list[ObjectView]:
    """Every view of every object below ``root`` by the named cameras; an object's class is its folder's name.

    ``wanted`` tells by the table's angle which views are read at all; those whose mask is empty are left out. Raises
    InputError when there is nothing to read.
    """
    views = []
    for folder in tqdm(object_folders(root), desc="reading turntables", unit="object"):
        for view in turntable_views(folder, cameras):
            if wanted(view.angle_deg) and (mask := view.mask).any():
                azimuth, elevation, range_m = view.viewpoint
                cutout, alpha = cut_out(view.image, mask)
                views.append(ObjectView(view.object_name, azimuth, elevation, range_m, cutout, alpha, view.angle_deg))
    if not views:
        raise InputError(f"{root}: every mask is empty; restore the masks of the data set")
    return views


def views_of(photographs: Sequence[Photograph]) -> list[ObjectView]:
    """A view for each photograph, in their order; an object's class is its name. Raises InputError.

    Pictures without an object in them are left out.
    """
    views = []
    for photograph in tqdm(photographs, desc="reading photographs", unit="picture"):
        image, mask = photograph.pixels()
        if mask.any():
            cutout, alpha = cut_out(image, mask)
            azimuth = float(wrap_angle(np.array(radians(photograph.azimuth_deg))))
            elevation = radians(photograph.elevation_deg)
            angle = round(photograph.azimuth_deg) % 360
            name, range_m = photograph.object_name, photograph.range_m
            views.append(ObjectView(name, azimuth, elevation, range_m, cutout, alpha, angle))
    if not views:
        raise InputError("photographs: no object in any of them; give masks, or pictures before a plain background")
    return views


def class_names_of(views: Sequence[ObjectView]) -> tuple[str, ...]:
    """The classes of the views, sorted."""
    return tuple(sorted({view.class_name for view in views}))


def with_classes(views: Sequence[ObjectView], path: Path) -> tuple[list[ObjectView], list[str]]:
    """The views under the class of their instance, as ``read_classes`` has it; others are left out.

    Also lines about the instances that the file does not name, and about the names that no instance has. Raises
    InputError when the file is no such thing, or names none of the instances.
    """
    classes, instances = read_classes(path), class_names_of(views)
    found = [replace(view, class_name=classes[view.class_name]) for view in views if view.class_name in classes]
    if not found:
        raise InputError(f"{path}: names none of the turntables' instances; correct the names")
    without = [name for name in instances if name not in classes]
    lines = [f"left out: instances without a class ({len(without)}): {', '.join(without)}"] if without else []
    return found, [*lines, *unknown_names(path, classes, instances)]


def classes_of_folders(files: Sequence[Path], instances: Collection[str]) -> tuple[dict[str, str], list[str]]:
    """{instance: class} by the files in folders of turntables, {} without files; raises InputError.

    An instance that no file names is a class of its own. Also lines about these, and about names that no instance has.
    """
    classes: dict[str, str] = {}
    lines = []
    for file in files:
        of_file = read_classes(file)
        lines += unknown_names(file, of_file, instances)
        classes |= of_file
    without = sorted(set(instances) - set(classes)) if files else []
    if without:
        lines.append(
            f"{files[0]}: instances without a class, each a class of its own ({len(without)}): {', '.join(without)}"
        )
    return ({name: name for name in instances} | classes if classes else {}), lines


def unknown_names(path: Path, classes: Mapping[str, str], instances: Collection[str]) -> list[str]:
    """A line about the names in a file {instance: class} that no instance has; none where there are no such names."""
    unknown = sorted(set(classes) - set(instances))
    return [f"{path}: names that no turntable has ({len(unknown)}): {', '.join(unknown)}"] if unknown else []


def read_classes(path: Path) -> dict[str, str]:
    """A JSON file {instance: class}; raises InputError when it is no such thing."""
    try:
        classes = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise InputError(f"{path}: not a readable JSON file ({fault}); give {{instance: class}}") from None
    if not isinstance(classes, dict) or not all(isinstance(name, str) for name in classes.values()):
        raise InputError(f"{path}: must map the names of instances to those of classes; correct the file")
    return classes
