"""``semantic_slam map {save,show,diff,merge}``: maps that outlive their run."""

import json
from argparse import Namespace
from pathlib import Path

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.cli.find_lookalike import belief_bag
from semantic_slam.outputs import add_overwrite, claimed

MAP_HELP = "FILE.map, or objects.json"


def save() -> None:
    """``map save``."""
    run_main(_save)


def show() -> None:
    """``map show``."""
    run_main(_show)


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
    from semantic_slam.maps.from_run import saved_map_of_bag
    from semantic_slam.maps.map_file import write_map

    bag = belief_bag(arguments.belief)
    with claimed(arguments.out, [bag], arguments.overwrite) as out:
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
