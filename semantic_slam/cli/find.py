"""``semantic_slam find BELIEF``: find objects of a map by class, vector, text, image or place, or look at one."""

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from semantic_slam.cli import find_lookalike, find_object, find_place
from semantic_slam.cli.exit_codes import CommandParser, program, run_main
from semantic_slam.errors import InputError

if TYPE_CHECKING:
    from semantic_slam.answers.find_objects import Found
    from semantic_slam.answers.question import Question
    from semantic_slam.answers.region import Region


def parse(words: list[str] | None = None) -> Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="The objects of a map that are what is looked for, each with its probability: of a class that the"
        " map knows, of a vector of appearance where detections carried such vectors, of a name among vectors of texts,"
        " or, with semantic_model.kind: latent, of a picture; or what is at a place, and what should be there and is"
        " not; or all that is known of one object.",
    )
    parser.add_argument("belief", type=Path, metavar="REPORT_OR_BELIEF_BAG", help="folder of a report, or belief bag")
    parser.add_argument("crop", type=Path, nargs="?", metavar="CROP", help="picture of the object, png or jpeg")
    parser.add_argument("--name", default="", metavar="NAME", help="class, or with --text-vectors one of its names")
    parser.add_argument("--vector", type=Path, metavar="FILE", help="vector of a picture: .npy, .json, or one as below")
    parser.add_argument("--place", action="store_true", help="what is in the region, and what is gone from there")
    parser.add_argument(
        "--object", default="", metavar="ID", help="all that is known of the one of that name, or else of that number"
    )
    parser.add_argument(
        "--text-vectors", type=Path, metavar="FILE", help="named vectors of texts: .npz, .safetensors or .json"
    )
    parser.add_argument(
        "--least-probability", type=float, default=0.0, metavar="P", help="leave out what is less probable (default: 0)"
    )
    parser.add_argument(
        "--region",
        type=float,
        nargs=4,
        metavar=("X0", "Y0", "X1", "Y1"),
        help="of the map, metres (default: all)",
    )
    parser.add_argument(
        "--mapped", type=float, default=0.5, metavar="P", help="probability that it is on the map at all (default: 0.5)"
    )
    find_lookalike.add_view(parser)
    return parser.parse_args(words)


def command() -> None:
    """Parse, query, print; raises InputError."""
    arguments = parse()
    asked = [name for name in ("crop", "name", "vector", "place", "object") if getattr(arguments, name)]
    if len(asked) != 1:
        raise InputError(
            f"{program()}: give one of CROP, --name, --vector, --place and --object; {program()} --help tells more"
        )
    if arguments.object:
        find_object.ask(arguments.belief, arguments.object)
        return
    if arguments.place:
        find_place.ask(arguments.belief, _region(arguments), arguments.least_probability)
        return
    if arguments.crop is not None:
        from semantic_slam.answers.question import check_limits

        limits = _region(arguments), arguments.least_probability
        check_limits(*limits)
        find_lookalike.ask(arguments, *limits)
        return
    from semantic_slam.answers.appearances import appearances_of
    from semantic_slam.answers.find_objects import find_objects
    from semantic_slam.configuration import from_dict
    from semantic_slam.evaluation.belief_bag import read_record
    from semantic_slam.evaluation.record import json_object

    question = _question(arguments)
    record = read_record(arguments.belief)
    settings = from_dict(json_object(record.run.configuration), str(arguments.belief)).semantic_model
    needs_looks = question.vector is not None or bool(question.text_vectors)
    looks = appearances_of(record.beliefs, record.measurements, settings) if needs_looks else None
    print("\n".join(table(find_objects(record.beliefs[-1], question, looks))))


def _question(arguments: Namespace) -> "Question":
    from semantic_slam.answers.question import Question
    from semantic_slam.answers.text_vectors import read_text_vectors, read_vector

    return Question(
        name=arguments.name,
        vector=read_vector(arguments.vector) if arguments.vector else None,
        text_vectors=read_text_vectors(arguments.text_vectors) if arguments.text_vectors else {},
        region=_region(arguments),
        least_probability=arguments.least_probability,
        mapped=arguments.mapped,
    )


def _region(arguments: Namespace) -> "Region | None":
    return tuple(arguments.region) if arguments.region else None


def table(found: "Found") -> list[str]:
    """Table with a row per object, the likeliest first, and one for none of them."""
    lines = [f"{'probability':>11}  {'object':>6}  {'x [m]':>8}  {'y [m]':>8}  name"]
    for item in found.objects:
        x, y = item.pose[:2]
        lines.append(f"{item.probability:11.4f}  {item.object_id:6d}  {x:8.2f}  {y:8.2f}  {item.name}")
    return [*lines, f"{found.unknown:11.4f}  {'-':>6}  {'':>8}  {'':>8}  none of them"]


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
