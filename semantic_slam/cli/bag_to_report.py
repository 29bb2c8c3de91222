"""``bag_to_report BAG... --out DIR``: report on an input bag, after running the pipeline on it, or on a belief bag."""

from argparse import Namespace
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError
from semantic_slam.outputs import add_overwrite, claimed_report
from semantic_slam.shipped import DEFAULT_CONFIGURATION, configuration_file

if TYPE_CHECKING:
    from semantic_slam.configuration import Configuration

MOST_COMPARED = 4
"""Maximum number of compared runs besides the main one, which the report's charts can distinguish."""


def parse(words: list[str] | None = None) -> Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Report, map and trajectory of a bag: the pipeline runs on a bag of sensor data (its beliefs go to"
        " DIR/belief); a bag that holds beliefs is reported as it is.",
    )
    _add_files(parser)
    _add_run(parser)
    _add_contents(parser)
    _add_work(parser)
    add_overwrite(parser)
    arguments = parser.parse_args(words)
    arguments.bag = arguments.bags[0]
    for name, least in (("seed", 0), ("max_keyframes", 1), ("processes", 1), ("jobs", 1)):
        value = getattr(arguments, name)
        if value is not None and value < least:
            raise InputError(f"--{name.replace('_', '-')} {value}: must be at least {least}; correct the number")
    if arguments.out.exists() and not arguments.out.is_dir():
        raise InputError(f"{arguments.out}: is a file; name a folder for the report")
    check_names(arguments)
    return arguments


def _add_files(parser: CommandParser) -> None:
    """Add the bags, and the folder of the report."""
    parser.add_argument(
        "bags",
        type=Path,
        nargs="+",
        metavar="BAG",
        help="rosbag2 folder, .mcap or .db3; of several each gets a report in DIR/<its name>,"
        " and DIR/index.html compares them",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the report's files")


def _add_run(parser: CommandParser) -> None:
    """Add what the run is made with."""
    parser.add_argument(
        "--config",
        type=configuration_file,
        metavar="YAML",
        help="file, or the name of a shipped configuration (default: default, or detector or"
        " detector_second_session where the bag or its map has other classes than the default's)",
    )
    parser.add_argument(
        "--seed", type=int, metavar="N", help="seed of every random draw, instead of the configuration's"
    )
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after that many keyframes")
    parser.add_argument(
        "--map-prior", type=Path, metavar="MAP", help="FILE.map or objects.json (default: objects.json beside BAG)"
    )


def _add_contents(parser: CommandParser) -> None:
    """Add what the report shows besides."""
    parser.add_argument(
        "--compare",
        type=configuration_file,
        action="append",
        metavar="YAML",
        help="run the bag with this configuration, too, and set the runs side by side; may be given up to"
        f" {MOST_COMPARED} times (beliefs go to DIR/belief_<name of the file>)",
    )
    parser.add_argument(
        "--explain", action="store_true", help="the evidence for each object in the report; infers the run once more"
    )


def _add_work(parser: CommandParser) -> None:
    """Add how the work is divided."""
    parser.add_argument(
        "--processes",
        type=int,
        metavar="N",
        help="that share a run: 1: all in one; 2: another one reads ahead; more: the others share the hypotheses of a"
        " crowded drive (default: 2 for a long bag where there are two cores, else 1); the beliefs are the same",
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="bags at once (default: 1)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler that gets the bags (default: none)")


def check_names(arguments: Namespace) -> None:
    """Raises InputError if the compared runs are too many or share a name."""
    compared = arguments.compare or []
    if len(compared) > MOST_COMPARED:
        raise InputError(
            f"--compare: given {len(compared)} times; at most {MOST_COMPARED} runs fit beside the main one"
        )
    names = [run_name(arguments.config), *(run_name(path) for path in compared)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"--compare {twice[0]}.yaml: two configurations have that name; rename one of the files")


def run_name(configuration: Path | None) -> str:
    """Name of a run: the stem of its configuration file."""
    return (configuration or DEFAULT_CONFIGURATION).stem


def command() -> None:
    """Parse, run, report; raises InputError, for a damaged bag after the report has been written."""
    arguments = parse()
    if len(arguments.bags) > 1:
        from semantic_slam.cli.many_reports import report_many

        print_files(report_many(arguments))
        return
    if arguments.scheduler:
        print("--scheduler has no effect: a single bag is run here")
    inputs = [arguments.bag, arguments.config, arguments.map_prior, *(arguments.compare or [])]
    with claimed_report(arguments.out, inputs, arguments.overwrite) as out:
        files, fault = report(arguments, out)
    print_files([arguments.out / path.name for path in files])
    if fault is not None:
        raise fault


def report(arguments: Namespace, out: Path) -> tuple[list[Path], InputError | None]:
    """Write the report into ``out``; returns its files and the error that ended the input early. Raises InputError."""
    from semantic_slam.report.make import make_report

    if holds_beliefs(arguments.bag):
        _announce_unused(arguments)
        return make_report(arguments.bag, out, with_evidence=arguments.explain), damage_of(arguments.bag)
    if arguments.config is None:
        from semantic_slam.maps.map_file import read_map_prior
        from semantic_slam.pipeline.default_configuration import configuration_for

        prior = read_map_prior(arguments.map_prior) if arguments.map_prior else None
        arguments.config = configuration_for(arguments.bag, prior)
        check_names(arguments)
    paths = [arguments.config, *(arguments.compare or [])]
    runs = {run_name(path): effective_configuration(path, arguments.seed) for path in paths}
    _check_runs(arguments, runs.values())
    names = list(runs)
    beliefs = {name: out / (f"belief_{name}" if name != names[0] else "belief") for name in names}
    faults = [run(arguments, name, runs[name], beliefs[name]) for name in names]
    compared = {name: beliefs[name] for name in names[1:]}
    explain = arguments.explain
    return make_report(beliefs[names[0]], out, arguments.bag, names[0], compared, with_evidence=explain), faults[0]


def _check_runs(arguments: Namespace, configurations: Iterable["Configuration"]) -> None:
    """Raise InputError for what would end one of the runs at its first keyframe: not after the runs before it."""
    from semantic_slam.inference.building import check_run
    from semantic_slam.maps.map_file import read_map_prior
    from semantic_slam.pipeline.preamble import find_map_prior

    prior = read_map_prior(arguments.map_prior) if arguments.map_prior else find_map_prior(arguments.bag)
    for configuration in configurations:
        check_run(configuration, prior)


def effective_configuration(path: Path | None, seed: int | None) -> "Configuration":
    """Configuration of a run, with the given seed; raises InputError."""
    from semantic_slam.configuration import from_dict, load_configuration, to_dict

    configuration = load_configuration(path or DEFAULT_CONFIGURATION)
    return configuration if seed is None else from_dict({**to_dict(configuration), "seed": seed}, "--seed")


def run(arguments: Namespace, name: str, configuration: "Configuration", beliefs: Path) -> InputError | None:
    """Run the pipeline with one configuration, writing ``beliefs``; returns the error that ended the input early.

    Raises InputError.
    """
    from semantic_slam.inference.relocation.carried_spans import carried_line
    from semantic_slam.maps.map_file import read_map_prior
    from semantic_slam.pipeline.shared_run import run_shared

    if arguments.compare:
        print(f"run: {name}")
    prior = read_map_prior(arguments.map_prior) if arguments.map_prior else None
    summary = run_shared(arguments.bag, beliefs, configuration, prior, arguments.max_keyframes, arguments.processes)
    print(f"{summary.num_keyframes} keyframes of {summary.num_frames} frames")
    for reason, count in sorted(summary.dropped.items()):
        print(f"dropped: {reason} ({count})")
    if summary.carried:
        print(carried_line(summary.carried, learns_region=configuration.open_world.learn_region))
    return summary.fault


def holds_beliefs(bag: Path) -> bool:
    """Whether a bag is a belief bag; raises InputError if it cannot be read."""
    from semantic_slam.bag.reader import BagReader
    from semantic_slam.messages.topics import BELIEF

    with BagReader(bag) as reader:
        return BELIEF in reader.topics


def damage_of(bag: Path) -> InputError | None:
    """The error of a damaged bag; None if it can be read to its end."""
    from semantic_slam.bag.reader import BagReader

    try:
        with BagReader(bag) as reader:
            for _ in reader.messages():
                pass
    except InputError as fault:
        return fault
    return None


def print_files(files: list[Path]) -> None:
    for path in files:
        print(path)


def _announce_unused(arguments: Namespace) -> None:
    """Print which options have no effect on a belief bag, whose beliefs are not recomputed."""
    for name in ("config", "seed", "max_keyframes", "map_prior", "compare", "processes"):
        if getattr(arguments, name) is not None:
            print(
                f"--{name.replace('_', '-')} has no effect: {arguments.bag} holds beliefs, which are not computed again"
            )


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
