"""``semantic_slam view``: serves a browser page that shows a run live."""

from argparse import Namespace
from importlib import import_module

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.cli.needs import need_ros
from semantic_slam.messages.topics import BELIEF

ROS_ARGUMENTS = "--ros-args"
ON_ROS = "semantic_slam.ros.observers.view"
"""Module imported by name, like the nodes, since ROS modules import this package in turn."""


def parse(words: list[str]) -> Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="A page in the browser that follows a run while it goes on: map, hypotheses, camera, what the nodes"
        " say. It only listens, and slows nothing down.",
        epilog=f"{ROS_ARGUMENTS} -r image/compressed:=/camera/color/image_raw/compressed names your camera's topic.",
    )
    parser.add_argument("--port", type=int, default=8321, help="0: any that is free (default: %(default)s)")
    parser.add_argument(
        "--host", default="127.0.0.1", metavar="ADDRESS", help="0.0.0.0: for other machines, too (default: %(default)s)"
    )
    parser.add_argument("--belief", default=BELIEF, metavar="TOPIC", help="default: %(default)s")
    return parser.parse_args(words)


def command(words: list[str]) -> None:
    """Parse and serve until interrupted; raises InputError."""
    at = words.index(ROS_ARGUMENTS) if ROS_ARGUMENTS in words else len(words)
    arguments = parse(words[:at])
    need_ros()
    serve = import_module(ON_ROS).serve
    serve(arguments.host, arguments.port, arguments.belief, words[at:])


def main() -> None:
    import sys

    run_main(lambda: command(sys.argv[1:]))


if __name__ == "__main__":
    main()
