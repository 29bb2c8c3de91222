"""Turntable views for the commands that learn from them: common flags, and loading of the views."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from semantic_slam.errors import InputError

if TYPE_CHECKING:
    from semantic_slam.datasets.turntables.photographs import Turntables
    from semantic_slam.training.views import ObjectView

TABLE = ".csv"


OF_TURNTABLES = "--turntables holds photographs; a .csv file as --turntables lists them itself"


def add_photographs(parser: argparse.ArgumentParser, where: str = OF_TURNTABLES) -> None:
    """Add the flags for turntable photographs; ``where`` says in which folder they are, and what else may be there."""
    parser.add_argument(
        "--pattern",
        metavar="TEXT",
        help="photographs whose paths tell object and degrees, such as '{object}__{azimuth}.jpg'; other fields:"
        f" clockwise, elevation, polar ({where})",
    )
    parser.add_argument(
        "--mask-pattern",
        metavar="TEXT",
        help="path of each photograph's mask with the same fields, bright on the object; default: the background is"
        " plain, of the border's colour",
    )


def check_photographs(arguments: argparse.Namespace, roots: list[Path]) -> None:
    """Raises InputError for flags that cannot be combined."""
    if arguments.mask_pattern and not arguments.pattern:
        raise InputError("--mask-pattern: only with --pattern; add it, or leave both out")
    if arguments.pattern and (not roots or any(root.suffix == TABLE for root in roots)):
        raise InputError("--pattern: only for a folder of photographs as --turntables; leave it out")


def object_views(
    arguments: argparse.Namespace, root: Path, wanted: Callable[[int], bool] = lambda angle_deg: True
) -> "list[ObjectView]":
    """Load the views below ``root``; ``wanted`` selects by angle [deg], for BigBIRD only. Raises InputError."""
    from semantic_slam.training.turntables import load_views, views_of

    if not arguments.pattern and root.suffix != TABLE:
        return load_views(root, tuple(arguments.cameras.split(",")), wanted)
    found = _photographs(arguments, root)
    views = views_of(found.photographs)
    empty = len(found.photographs) - len(views)
    for count, reason in ((found.other_files, "files that are no such photograph"), (empty, "without an object")):
        if count:
            print(f"left out: {reason} ({count})", file=sys.stderr)
    return views


def object_names(arguments: argparse.Namespace, root: Path) -> list[str]:
    """Names of the objects below ``root``, before any picture is read. Raises InputError."""
    from semantic_slam.datasets.bigbird import object_folders

    if not arguments.pattern and root.suffix != TABLE:
        return [folder.name for folder in object_folders(root)]
    return sorted({photograph.object_name for photograph in _photographs(arguments, root).photographs})


def in_classes(arguments: argparse.Namespace, views: "list[ObjectView]") -> "list[ObjectView]":
    """The views under the classes of ``--classes``, if given; what matches nothing is told. Raises InputError."""
    from semantic_slam.training.turntables import with_classes

    if not arguments.classes:
        return views
    found, lines = with_classes(views, arguments.classes)
    for line in lines:
        print(line, file=sys.stderr)
    return found


def _photographs(arguments: argparse.Namespace, root: Path) -> "Turntables":
    from semantic_slam.datasets.turntables.photographs import by_pattern, by_table

    if root.suffix == TABLE:
        return by_table(root)
    return by_pattern(root, arguments.pattern, arguments.mask_pattern or "")
