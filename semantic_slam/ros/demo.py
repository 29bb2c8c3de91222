"""``demo``: replays a bag through all nodes, each in its own process, and reports the beliefs they publish."""

import argparse
import os
import shutil
import sys
from contextlib import AbstractContextManager
from pathlib import Path

from semantic_slam.cli.exit_codes import FAULT, CommandParser, program, run_main
from semantic_slam.cli.needs import need_ros
from semantic_slam.errors import InputError, SemanticSlamError
from semantic_slam.outputs import add_overwrite, claimed_folder_again, claimed_report
from semantic_slam.shipped import configuration_file

DOMAINS = 50
"""Demos without ROS_DOMAIN_ID use the domains 1 to 50; others running here, such as tests, use higher ones."""
LAST_DOMAIN = 232
JOURNAL = "journal"
REPLAY_TIMEOUT_S = 3600.0
"""How much longer than the recording a replay may take before it is given up."""
LEAST_RATE = 0.1
"""How fast a lossless replay is at least, by the time of the recording."""


def parse(words: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Replay a bag through all nodes, each its own process, and report the belief they publish."
    )
    parser.add_argument("--bag", type=Path, default=Path("bags/aliased_room"), help="input bag (default: %(default)s)")
    parser.add_argument(
        "--config",
        type=configuration_file,
        metavar="YAML",
        help="file, or the name of a shipped configuration (default: default, or detector or"
        " detector_second_session where the bag or its map has other classes than the default's)",
    )
    parser.add_argument("--backends", type=int, default=2, help="number of backends (default: %(default)s)")
    parser.add_argument("--rate", type=float, default=0.0, help="0 (default): lossless, 1: real time")
    parser.add_argument("--out", type=Path, default=Path("out/demo"), help="default: %(default)s")
    add_overwrite(parser)
    parser.add_argument("--resume", action="store_true", help="go on with a demo in --out that was broken off")
    return parser.parse_args(words)


def command() -> None:
    """Replay, record and report; raises SemanticSlamError, with the last lines of a node that died."""
    arguments = parse()
    need_ros()
    if arguments.config is None:
        from semantic_slam.pipeline.default_configuration import configuration_for

        arguments.config = configuration_for(arguments.bag)
    from semantic_slam.bag.metadata_check import METADATA

    with output_of(arguments) as out:
        if not (arguments.resume and (out / "belief" / METADATA).exists()):
            replay(arguments, out / "belief")
        from semantic_slam.report.make import make_report

        paths = make_report(out / "belief", out, source_bag=arguments.bag)
    shutil.rmtree(arguments.out / JOURNAL, ignore_errors=True)
    print(f"belief bag   {arguments.out / 'belief'}")
    for path in paths:
        print(f"{path.suffix[1:]:12} {arguments.out / path.name}")


def output_of(arguments: argparse.Namespace) -> AbstractContextManager[Path]:
    """Context with the output folder; raises InputError."""
    if not arguments.resume:
        return claimed_report(arguments.out, [arguments.bag, arguments.config], arguments.overwrite)
    from semantic_slam.pipeline.journal.journal import FILE

    if not (arguments.out / JOURNAL / FILE).exists():
        raise InputError(f"{arguments.out}: no demo was broken off there; leave out --resume")
    return claimed_folder_again(arguments.out)


def replay(arguments: argparse.Namespace, belief: Path) -> None:
    """Run the nodes until the recorder and the player have ended."""
    from semantic_slam.ros.launching.node_set import RunOptions, node_set
    from semantic_slam.ros.launching.processes import NodeProcesses, loopback_environment
    from semantic_slam.ros.launching.supervisor import Supervisor
    from semantic_slam.ros.wire.transport import is_installed

    specs = node_set(
        arguments.bag,
        arguments.config,
        arguments.rate,
        RunOptions(
            backends=arguments.backends,
            record=str(belief),
            journal=str(arguments.out / JOURNAL),
            resume=arguments.resume,
        ),
        has_tf2=is_installed("tf2_msgs/msg/TFMessage"),
        has_stereo=is_installed("stereo_msgs/msg/DisparityImage"),
    )
    domain_id = domain()
    print(f"{arguments.bag}: {len(specs)} nodes in ROS domain {domain_id}, on this machine only", file=sys.stderr)
    with NodeProcesses(arguments.out / "log", loopback_environment(domain_id), Supervisor(specs)) as nodes:
        for spec in specs:
            nodes.start(spec, show_errors=spec.name == "bag_player")
        timeout_s = replay_timeout_s(arguments.bag, arguments.rate)
        nodes.wait("bag_recorder", timeout_s)
        nodes.wait("bag_player", timeout_s)


def replay_timeout_s(bag: Path, rate: float) -> float:
    """Seconds after which a replay of the bag at ``rate`` (0: lossless) is given up; raises InputError."""
    from semantic_slam.bag.reader import BagReader

    with BagReader(bag, announces=False) as reader:
        return REPLAY_TIMEOUT_S + reader.duration_s / (rate or LEAST_RATE)


def domain() -> int:
    """ROS_DOMAIN_ID if set, else one by process id, apart from nodes in the default domain; raises InputError."""
    told = os.environ.get("ROS_DOMAIN_ID", "")
    if not told:
        return 1 + os.getpid() % DOMAINS
    if not (told.isascii() and told.isdigit() and int(told) <= LAST_DOMAIN):
        raise InputError(f"ROS_DOMAIN_ID is '{told}'; set a number from 0 to {LAST_DOMAIN}, or unset it")
    return int(told)


def main() -> None:
    run_main(_explained)


def _explained() -> None:
    """Run the command; for a SemanticSlamError print its text, a node's last lines, instead of a traceback."""
    try:
        command()
    except InputError:
        raise
    except SemanticSlamError as fault:
        print(f"{program()}: {fault}", file=sys.stderr)
        sys.exit(FAULT)
