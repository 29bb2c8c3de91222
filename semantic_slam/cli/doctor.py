"""``semantic_slam doctor [BAG]``: finds problems of a bag, or of the running system, that would spoil the map."""

import json
import sys
from argparse import Namespace
from contextlib import redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.cli.needs import need_ros
from semantic_slam.errors import InputError
from semantic_slam.shipped import DEFAULT_CONFIGURATION, configuration_file

if TYPE_CHECKING:
    from semantic_slam.configuration import Configuration
    from semantic_slam.doctor.finding import Finding
    from semantic_slam.inference.protocol import RunConfiguration
    from semantic_slam.inference.world.map_prior import MapPrior

ROS_ARGUMENTS = "--ros-args"
ON_ROS = "semantic_slam.ros.observers.examination"
"""Module imported by name, like the nodes, since ROS modules import this package in turn."""


def parse(words: list[str] | None = None) -> Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Look for what would keep a bag from giving a right map, or, without BAG, the running system: one"
        " line for each thing that is wrong, with numbers and a remedy. Exit code 0: nothing, or warnings alone; 2: an"
        " error, with which a run would not start or its result would not be right.",
        epilog="Without BAG, remappings of inputs follow --ros-args, as for the nodes: -r odom:=/my/odom.",
    )
    parser.add_argument("bag", type=Path, nargs="?", metavar="BAG", help="rosbag2 folder, .mcap or .db3")
    parser.add_argument(
        "--config",
        type=configuration_file,
        metavar="YAML",
        help="file, or the name of a shipped configuration (default: what semantic_slam report takes, or took of a"
        " belief bag; of a running system the parameters of its nodes)",
    )
    parser.add_argument(
        "--map-prior",
        type=Path,
        metavar="MAP",
        help="FILE.map or objects.json of objects known before (default: objects.json beside BAG, or that of a"
        " belief bag's run; of a running system the map of its manager)",
    )
    parser.add_argument(
        "--seconds", type=float, default=5.0, metavar="N", help="how long a running system is listened to (default: 5)"
    )
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    words = sys.argv[1:] if words is None else words
    own = words[: words.index(ROS_ARGUMENTS)] if ROS_ARGUMENTS in words else words
    arguments = parser.parse_args(own)
    if not 0.5 <= arguments.seconds <= 600.0:
        raise InputError(f"--seconds {arguments.seconds:g}: must be from 0.5 to 600; correct the number")
    arguments.ros = words[len(own) :]
    if arguments.ros and arguments.bag:
        raise InputError(f"{ROS_ARGUMENTS}: are for a running system; leave out {arguments.bag}, or them")
    return arguments


def command() -> None:
    """Parse, examine, print; raises InputError if any finding is an error."""
    arguments = parse()
    with redirect_stdout(sys.stderr):
        findings = of_bag(arguments) if arguments.bag else of_running_system(arguments)
    subject = str(arguments.bag or "running system")
    print(as_json(subject, findings) if arguments.json else as_text(findings))
    errors = sum(each.severity.name == "ERROR" for each in findings)
    if errors:
        raise InputError(
            f"{subject}: {errors} error{'s' * (errors > 1)} and {len(findings) - errors} warnings; see the remedies"
        )


def of_bag(arguments: Namespace) -> "list[Finding]":
    """Findings on a bag. Raises InputError if there is no such bag."""
    from semantic_slam.bag.reader import REMEDY
    from semantic_slam.doctor.bag_summary import summarise_bag
    from semantic_slam.doctor.examination import examine
    from semantic_slam.doctor.finding import of_fault
    from semantic_slam.doctor.recorded_run import recorded_run

    if not arguments.bag.exists():
        raise InputError(f"{arguments.bag}: no such bag; {REMEDY}")
    run = recorded_run(arguments.bag)
    if run is not None:
        print(f"{arguments.bag}: a recorded run; its configuration and map are used where no others are given")
    try:
        prior = _map_prior(arguments, run)
    except InputError as fault:
        return [of_fault("map prior", fault)]
    try:
        configuration = _configuration(arguments, run, prior)
    except InputError as fault:
        return [of_fault("configuration", fault)]
    summary, faults = summarise_bag(arguments.bag, configuration, prior)
    return [*faults, *examine(summary)]


def _map_prior(arguments: Namespace, run: "RunConfiguration | None") -> "MapPrior | None":
    """Map that is given, that of the recorded ``run``, or the one beside the bag. Raises InputError."""
    from semantic_slam.inference.world.map_prior import parse_map_prior
    from semantic_slam.maps.map_file import read_map_prior
    from semantic_slam.pipeline.preamble import map_prior_path

    if run is not None and arguments.map_prior is None:
        return parse_map_prior(run.map_prior, str(arguments.bag)) if run.map_prior else None
    path = arguments.map_prior or map_prior_path(arguments.bag)
    return read_map_prior(path) if path else None


def _configuration(arguments: Namespace, run: "RunConfiguration | None", prior: "MapPrior | None") -> "Configuration":
    """Configuration that is given, that of the recorded ``run``, or the usual one. Raises InputError."""
    from semantic_slam.configuration import from_dict, load_configuration
    from semantic_slam.evaluation.record import json_object

    if run is not None and arguments.config is None:
        return from_dict(json_object(run.configuration), str(arguments.bag))
    return load_configuration(arguments.config or _usual(arguments.bag, prior))


def _usual(bag: Path, prior: "MapPrior | None") -> Path:
    """Configuration file that ``semantic_slam report`` would use."""
    from semantic_slam.pipeline.default_configuration import configuration_for

    try:
        return configuration_for(bag, prior)
    except InputError:
        return DEFAULT_CONFIGURATION  # the examination reports the problem of the bag


def of_running_system(arguments: Namespace) -> "list[Finding]":
    """Findings on the running nodes and topics. Raises InputError without ROS."""
    need_ros()
    examine = import_module(ON_ROS).examine_running_system
    found: list[Finding] = examine(arguments.config, arguments.map_prior, arguments.seconds, arguments.ros)
    return found


def as_text(findings: "list[Finding]") -> str:
    """One line per finding."""
    return "\n".join(finding.line for finding in findings) or "nothing wrong"


def as_json(subject: str, findings: "list[Finding]") -> str:
    """JSON object with the subject examined and the list of findings."""
    rows = [
        {"severity": each.severity.name.lower(), "check": each.check, "what": each.what, "remedy": each.remedy}
        for each in findings
    ]
    return json.dumps({"schema_version": 1, "examined": subject, "findings": rows}, indent=1)


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
