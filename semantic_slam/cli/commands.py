"""``semantic_slam COMMAND …``: dispatches to all commands; ``bag_to_report`` and the like are aliases of them."""

import sys
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module

import semantic_slam
from semantic_slam.cli.exit_codes import CommandParser, program, run_main


@dataclass(frozen=True)
class Command:
    """One command: ``module:function``, a function without arguments, imported only when it is called."""

    target: str
    summary: str


@dataclass(frozen=True)
class Group:
    """Group of subcommands."""

    commands: "Mapping[str, Command | Group]"
    summary: str


TRAIN = Group(
    {
        "classifier": Command("semantic_slam.cli.train_classifier:main", "the compact network"),
        "latent": Command("semantic_slam.cli.train_latent_model:main", "a latent model of chapter 5"),
    },
    "learn a network or a latent model from turntable views",
)
MAP = Group(
    {
        "save": Command("semantic_slam.cli.map:save", "the map at the end of a run, into one file"),
        "show": Command("semantic_slam.cli.map:show", "what is on a map"),
        "diff": Command("semantic_slam.cli.map:diff", "what changed between two maps"),
        "merge": Command("semantic_slam.cli.map:merge", "one map of two"),
    },
    "save, show, compare and merge maps",
)
COMMANDS = Group(
    {
        "report": Command("semantic_slam.cli.bag_to_report:main", "run a bag, or take recorded beliefs, and report it"),
        "import": Command(
            "semantic_slam.cli.import_dataset:main", "write a data set, or your own bag, as an input bag"
        ),
        "demo": Command("semantic_slam.ros.demo:main", "replay a bag through the ROS nodes and report it"),
        "view": Command("semantic_slam.cli.view:main", "follow a run that goes on, in the browser"),
        "train": TRAIN,
        "fit": Command("semantic_slam.cli.fit_viewpoint_models:main", "fit class models over the direction of view"),
        "find": Command("semantic_slam.cli.find:main", "objects of a map by class, vector, text or picture, or one"),
        "explain": Command("semantic_slam.cli.explain:main", "why a map believes what it does of one object"),
        "map": MAP,
        "calibrate": Command("semantic_slam.cli.calibrate:main", "a robot's noise, by the evidence of a drive"),
        "doctor": Command("semantic_slam.cli.doctor:main", "what is wrong with a bag or a running system"),
        "study": Command("semantic_slam.cli.laboratory:study", "run an experiment (laboratory)"),
        "bench": Command("semantic_slam.cli.laboratory:bench", "measure against peers (laboratory)"),
        "scene": Command("semantic_slam.cli.laboratory:scene", "render a room, turntables or a bag (laboratory)"),
    },
    "object-level semantic SLAM",
)


def parse(group: Group, words: list[str]) -> Namespace:
    """Parse the first of ``words``, the command's name; the others are for the command itself. Raises InputError."""
    description = f"{group.summary}. {program()} COMMAND --help tells what each COMMAND takes."
    parser = CommandParser(description=description[0].upper() + description[1:])
    parser.add_argument("-V", "--version", action="version", version=f"semantic_slam {semantic_slam.__version__}")
    chosen = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, command in group.commands.items():
        chosen.add_parser(name, help=command.summary, add_help=False)
    return parser.parse_args(words[:1])


def run(group: Group, words: list[str]) -> None:
    """Call the command named by ``words``, with ``sys.argv`` set as for a separate program. Raises InputError."""
    name = parse(group, words).command
    chosen = group.commands[name]
    sys.argv = [f"{program()} {name}", *words[1:]]
    if isinstance(chosen, Group):
        run(chosen, words[1:])
    else:
        module, function = chosen.target.split(":")
        getattr(import_module(module), function)()


def main() -> None:
    run_main(lambda: run(COMMANDS, sys.argv[1:]))


if __name__ == "__main__":
    main()
