"""``make_scene --out DIR [--seed N] [--turntable | --standing]``: a room as AVD, turntables as BigBIRD, or a bag."""

import argparse
import json
from pathlib import Path

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError
from semantic_slam.outputs import add_overwrite, claimed_folder


def parse() -> argparse.Namespace:
    parser = CommandParser(
        description="Render furniture that looks alike from some sides: a room in the format of the Active Vision"
        " Dataset (DIR/Gen_<seed>_1, with ground_truth.json and tour.txt beside its files), or with --turntable every"
        " class on a turntable in BigBIRD's format (DIR/<class>; with --goods N that many instances of other classes,"
        " DIR/<class>_<number>; and DIR/classes.json), or with --standing the bag DIR/standing.mcap of a"
        " robot that stands still in the room of seed 0 (its map prior beside it). Needs EGL or OSMesa, not a screen.",
    )
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="data set folder to write into")
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="layout of the room, 0 to 999, or noise of --standing (default: 0)",
    )
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument("--turntable", action="store_true", help="write turntable views instead of a room")
    instead.add_argument("--standing", action="store_true", help="write the bag of a standing robot instead")
    parser.add_argument(
        "--tour-only", action="store_true", help="render only the images of tour.txt and between, a tenth of the time"
    )
    parser.add_argument(
        "--goods",
        type=int,
        default=0,
        metavar="N",
        help="N instances of goods on turntables, or pairs of them in the room, instead of furniture",
    )
    parser.add_argument(
        "--step-deg", type=int, default=3, metavar="A", help="angle between turntable views, divides 360 (default: 3)"
    )
    add_overwrite(parser)
    return parser.parse_args()


def command() -> None:
    """Parse the command line and render."""
    arguments = parse()
    if arguments.goods < 0:
        raise InputError(f"--goods {arguments.goods}: must be at least 0; correct the number")
    if arguments.turntable:
        _turntables(arguments)
    elif arguments.standing:
        _standing(arguments)
    else:
        _room(arguments)


def _turntables(arguments: argparse.Namespace) -> None:
    from semantic_slam_lab.simulation.furniture import MODELS
    from semantic_slam_lab.simulation.goods import goods_class, goods_names
    from semantic_slam_lab.simulation.turntable import TurntableSettings, write_turntables

    if arguments.step_deg < 1 or 360 % arguments.step_deg:
        raise InputError(f"--step-deg {arguments.step_deg}: must divide 360")
    names = goods_names(arguments.goods) or tuple(MODELS)
    classes = {name: goods_class(name) if arguments.goods else name for name in names}
    with claimed_folder(arguments.out, (), arguments.overwrite, (*names, "classes.json")) as out:
        folders = write_turntables(out, names, TurntableSettings(step_deg=arguments.step_deg))
        (out / "classes.json").write_text(json.dumps(classes, indent=1) + "\n", encoding="utf-8")
    print(f"{arguments.out}: turntable views of {', '.join(folder.name for folder in folders)}")


def _standing(arguments: argparse.Namespace) -> None:
    from semantic_slam_lab.simulation.standing import NAME, write_standing

    if arguments.seed < 0:
        raise InputError(f"--seed {arguments.seed}: must be at least 0; correct the number")
    with claimed_folder(arguments.out, (), arguments.overwrite, (f"{NAME}.mcap", f"{NAME}.objects.json")) as out:
        bag = write_standing(out, arguments.seed)
    print(f"{arguments.out / bag.name}: report it with bag_to_report; its map prior lies beside it")


def _room(arguments: argparse.Namespace) -> None:
    from semantic_slam_lab.simulation.avd_writer import scene_name
    from semantic_slam_lab.simulation.goods import CLASSES
    from semantic_slam_lab.simulation.scene import SceneSettings, make_scene

    if 0 < arguments.goods < 2 * len(CLASSES):
        raise InputError(
            f"--goods {arguments.goods}: a room takes pairs of any class; name at least {2 * len(CLASSES)}"
        )
    settings = SceneSettings(tour_only=arguments.tour_only, goods=arguments.goods)
    with claimed_folder(arguments.out, (), arguments.overwrite, (scene_name(arguments.seed),)) as out:
        folder = make_scene(out, arguments.seed, settings)
    print(f"{arguments.out / folder.name}: import it with import_dataset avd")


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
