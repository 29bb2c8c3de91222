"""``semantic_slam map {save,show,diff,merge}``: commands on saved maps."""

import json
from argparse import Namespace
from pathlib import Path

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.outputs import add_overwrite, claimed_file

MAP_HELP = "FILE.map, or objects.json"


def save() -> None:
    """Command ``semantic_slam map save``."""
    run_main(_save)


def show() -> None:
    """Command ``semantic_slam map show``."""
    run_main(_show)


def diff() -> None:
    """Command ``semantic_slam map diff``."""
    run_main(_diff)


def merge() -> None:
    """Command ``semantic_slam map merge``."""
    run_main(_merge)


def _save() -> None:
    parser = CommandParser(
        description="Write the map at the end of a run into one file, from which later runs start (--map-prior). The"
        " run's inference is done again from its belief bag, for what objects have in common is not in its beliefs."
    )
    parser.add_argument("belief", type=Path, metavar="REPORT_OR_BELIEF_BAG", help="folder of a report, or belief bag")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.map", help="the map")
    parser.add_argument(
        "--marginals", action="store_true", help="each object by itself, as the last belief has it; nothing is inferred"
    )
    add_overwrite(parser)
    arguments = parser.parse_args()
    from semantic_slam.evaluation.belief_bag import belief_bag
    from semantic_slam.maps.from_run import saved_map_of_bag
    from semantic_slam.maps.map_file import write_map

    bag = belief_bag(arguments.belief)
    with claimed_file(arguments.out, [bag], arguments.overwrite) as out:
        known = write_map(out, saved_map_of_bag(bag, marginals_alone=arguments.marginals))
    print(f"{arguments.out}: map {known.map_id}, {len(known.objects)} objects, {len(known.hypotheses)} hypotheses")


def _show() -> None:
    arguments = _one_map("The objects of a map, and where it comes from.")
    from semantic_slam.maps.map_file import read_map
    from semantic_slam.maps.telling import as_json, lines_of

    known = read_map(arguments.map)
    print(json.dumps(as_json(known), indent=1, allow_nan=False) if arguments.json else "\n".join(lines_of(known)))


def _one_map(description: str) -> Namespace:
    parser = CommandParser(description=description)
    parser.add_argument("map", type=Path, metavar="MAP", help=MAP_HELP)
    parser.add_argument("--json", action="store_true", help="with every digit, as JSON")
    return parser.parse_args()


def _diff() -> None:
    parser = CommandParser(
        description="What changed between two maps: each object the same, displaced, gone or new, with its probability,"
        " or unseen where the new run never looked. Maps of which one started from the other, or both from one, are of"
        " one frame; others are aligned by which objects are the same."
    )
    parser.add_argument("old", type=Path, metavar="OLD", help=MAP_HELP)
    parser.add_argument("new", type=Path, metavar="NEW", help=MAP_HELP)
    _add_frame(parser)
    parser.add_argument("--json", action="store_true", help="with every digit, as JSON")
    arguments = parser.parse_args()
    from semantic_slam.maps.comparison import Comparison
    from semantic_slam.maps.differences import difference
    from semantic_slam.maps.map_file import read_map
    from semantic_slam.maps.telling_changes import change_lines, changes_as_json

    changes = difference(Comparison.of(read_map(arguments.old), read_map(arguments.new), arguments.same_frame))
    lines = change_lines(changes)
    print(json.dumps(changes_as_json(changes), indent=1, allow_nan=False) if arguments.json else "\n".join(lines))


def _merge() -> None:
    parser = CommandParser(
        description="One map of two, in the frame of A: what both have is taken together, what was displaced is where B"
        " has it. Frames are told as for diff."
    )
    parser.add_argument("one", type=Path, metavar="A", help=MAP_HELP)
    parser.add_argument("other", type=Path, metavar="B", help=MAP_HELP)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.map", help="the map of both")
    _add_frame(parser)
    add_overwrite(parser)
    arguments = parser.parse_args()
    from semantic_slam.maps.map_file import read_map, write_map
    from semantic_slam.maps.merging import merged
    from semantic_slam.pipeline.provenance import revision

    with claimed_file(arguments.out, [arguments.one, arguments.other], arguments.overwrite) as out:
        maps = read_map(arguments.one), read_map(arguments.other)
        known = write_map(out, merged(*maps, revision(), arguments.same_frame))
    print(f"{arguments.out}: map {known.map_id}, {len(known.objects)} objects")


def _add_frame(parser: CommandParser) -> None:
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument(
        "--same-frame", dest="same_frame", action="store_true", default=None, help="take both maps to be of one frame"
    )
    chosen.add_argument(
        "--align", dest="same_frame", action="store_false", help="align the maps by which objects are the same"
    )
