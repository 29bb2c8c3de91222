"""``explain REPORT_OR_BELIEF_BAG --object ID``: explain the evidence behind a map's belief about one object."""

import json
from argparse import Namespace
from pathlib import Path

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError


def parse(words: list[str] | None = None) -> Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Why a map believes what it does of one object: which views said what of its class, in nats, which"
        " other objects they could have been of, and how these alternatives ended. The run's inference is done again"
        " from its belief bag, which takes as long as it did, without the pictures.",
    )
    parser.add_argument("belief", type=Path, metavar="REPORT_OR_BELIEF_BAG", help="folder of a report, or belief bag")
    parser.add_argument(
        "--object", required=True, metavar="ID", help="name of the object, or its number where none has that name"
    )
    parser.add_argument(
        "--classes",
        nargs=2,
        metavar=("A", "B"),
        help="compare these (default: the likeliest and its nearest rival)",
    )
    parser.add_argument(
        "--history", type=int, default=1, metavar="N", help="of the last belief, by weight (default: 1, the heaviest)"
    )
    parser.add_argument("--json", action="store_true", help="every history, with every digit, as JSON")
    arguments = parser.parse_args(words)
    if arguments.history < 1:
        raise InputError(f"--history {arguments.history}: must be at least 1; correct the number")
    return arguments


def command() -> None:
    """Parse, repeat the inference, print; raises InputError."""
    arguments = parse()
    from semantic_slam.answers.explain.as_json import as_json
    from semantic_slam.answers.explain.explanation import explain
    from semantic_slam.answers.explain.text import lines_of

    classes = tuple(arguments.classes) if arguments.classes else None
    explanation = explain(arguments.belief, arguments.object, classes)
    if arguments.history > len(explanation.histories):
        raise InputError(
            f"--history {arguments.history}: the last belief has {len(explanation.histories)}; choose one of these"
        )
    if arguments.json:
        print(json.dumps(as_json(explanation), indent=1, allow_nan=False))
    else:
        print("\n".join(lines_of(explanation, arguments.history - 1)))


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
