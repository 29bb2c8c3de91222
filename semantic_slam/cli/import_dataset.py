"""``import_dataset FORMAT [SRC] --out BAG``: convert data sets and users' bags into input bags."""

import argparse
import importlib
import sys
from types import ModuleType

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError
from semantic_slam.outputs import add_overwrite, claimed_bag

FORMATS = {
    "avd": (
        "semantic_slam.datasets.avd.avd_import",
        "a path through a scene in the format of the Active Vision Dataset",
    ),
    "bigbird": ("semantic_slam.datasets.bigbird_import", "turntable views of one object in BigBIRD's format"),
    "victoria_park": ("semantic_slam.datasets.victoria_park_import", "the outdoor drive that ships with gtsam"),
    "mrclam": ("semantic_slam.datasets.drives.mrclam_import", "one robot of the UTIAS data set MRCLAM"),
    "g2o": ("semantic_slam.datasets.drives.g2o_import", "a landmark graph, such as that of the DLR data set"),
    "kitti_tracking": ("semantic_slam.datasets.drives.kitti_tracking_import", "a drive of KITTI tracking"),
    "csv": ("semantic_slam.datasets.drives.csv_import", "tables of odometry and of detections as range and bearing"),
    "images": (
        "semantic_slam.datasets.image_folders.images_import",
        "pictures and depth of a hand-held camera, levelled by gravity",
    ),
    "tum_rgbd": (
        "semantic_slam.datasets.tum_rgbd.tum_rgbd_import",
        "a hand-held camera in all six with a detector's boxes, laid out as the TUM RGB-D benchmark",
    ),
    "bag": ("semantic_slam.datasets.user_bag.user_bag_import", "a ROS 2 bag of your own"),
}
"""Name -> (module with ``add_arguments(parser)`` and ``run(arguments, bag)``, description).

``bag`` is the path to write to, which may be a temporary one beside ``--out``; ``run`` returns the error that ended the
source early, or None.
"""


def parse(words: list[str]) -> tuple[ModuleType, argparse.Namespace]:
    """Module of the format named in ``words``, and the parsed arguments; raises InputError on bad usage."""
    parser = CommandParser(description="Write a data set as an input bag.")
    formats = parser.add_subparsers(dest="format", required=True, metavar="{" + ",".join(FORMATS) + "}")
    module = None
    for name, (module_name, text) in FORMATS.items():
        format_parser = formats.add_parser(name, help=text, description=f"Import {text}.")
        if name == next((word for word in words if not word.startswith("-")), None):
            module = importlib.import_module(module_name)  # only the format asked for: its imports may be heavy
            module.add_arguments(format_parser)
            add_overwrite(format_parser)
    arguments = parser.parse_args(words)
    assert module is not None
    return module, arguments


def command() -> None:
    """Parse the command line and import; raises InputError."""
    module, arguments = parse(sys.argv[1:])
    max_keyframes = getattr(arguments, "max_keyframes", None)
    if max_keyframes is not None and max_keyframes < 1:
        raise InputError(f"--max-keyframes {max_keyframes}: must be at least 1; leave it out to import everything")
    inputs = [getattr(arguments, name, None) for name in ("source", "path", "labels", "detector", "odometry")]
    with claimed_bag(arguments.out, inputs, arguments.overwrite) as bag:
        fault = module.run(arguments, bag)
    if fault is not None:
        raise fault


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
