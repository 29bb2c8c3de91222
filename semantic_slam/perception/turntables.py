"""Views of objects from a folder of turntables in BigBIRD's format."""

from collections.abc import Callable, Sequence
from pathlib import Path

from tqdm import tqdm

from semantic_slam.datasets.bigbird import object_folders, turntable_views
from semantic_slam.errors import InputError
from semantic_slam.perception.views import ObjectView, cut_out


def load_views(
    root: Path, cameras: Sequence[str], wanted: Callable[[int], bool] = lambda angle_deg: True
) -> list[ObjectView]:
    """Every view of every object below ``root`` by the named cameras; an object's class is its folder's name.

    ``wanted`` tells by the table's angle which views are read at all. Views whose mask is empty are left out. Raises InputError when there is nothing to read.
    """
    views = []
    for folder in tqdm(object_folders(root), desc="reading turntables", unit="object"):
        for view in turntable_views(folder, cameras):
            if wanted(view.angle_deg) and (mask := view.mask).any():
                azimuth, elevation, range_m = view.viewpoint
                cutout, alpha = cut_out(view.image, mask)
                views.append(
                    ObjectView(view.object_name, azimuth, elevation, range_m, cutout, alpha, view.angle_deg)
                )
    if not views:
        raise InputError(f"{root}: every mask is empty; restore the masks of the data set")
    return views


def class_names_of(views: Sequence[ObjectView]) -> tuple[str, ...]:
    """The classes of the views, sorted."""
    return tuple(sorted({view.class_name for view in views}))
