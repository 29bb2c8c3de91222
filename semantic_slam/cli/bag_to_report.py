"""``bag_to_report BAG --out DIR``: a report of an input bag, by running the pipeline on it, or of a belief bag."""

from argparse import Namespace
from pathlib import Path

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError

DEFAULT_CONFIGURATION = Path(__file__).parents[2] / "config" / "default.yaml"
"""In a checkout; it holds the built-in defaults, which are used where the file is missing."""


def parse(words: list[str] | None = None) -> Namespace:
    """Arguments of the command line; raises InputError."""
    parser = CommandParser(
        prog="bag_to_report",
        description="Report, map and trajectory of a bag: the pipeline runs on a bag of sensor data (its beliefs go to"
        " DIR/belief); a bag that holds beliefs is reported as it is.",
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 folder, .mcap or .db3")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the report's files")
    parser.add_argument("--config", type=Path, metavar="YAML", help="configuration (default: config/default.yaml)")
    parser.add_argument(
        "--seed", type=int, metavar="N", help="seed of every random draw, instead of the configuration's"
    )
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="stop after that many keyframes")
    parser.add_argument(
        "--map-prior", type=Path, metavar="objects.json", help="objects known before (default: objects.json beside BAG)"
    )
    arguments = parser.parse_args(words)
    for name, least in (("seed", 0), ("max_keyframes", 1)):
        value = getattr(arguments, name)
        if value is not None and value < least:
            raise InputError(f"--{name.replace('_', '-')} {value}: must be at least {least}; correct the number")
    if arguments.out.exists() and not arguments.out.is_dir():
        raise InputError(f"{arguments.out}: is a file; name a folder for the report")
    return arguments


def command() -> None:
    """Parse, run, report; raises InputError, after the report where the bag is only damaged."""
    arguments = parse()
    from semantic_slam.report.make import make_report  # heavy, and not needed for --help

    if holds_beliefs(arguments.bag):
        _announce_unused(arguments)
        print_files(make_report(arguments.bag, arguments.out))
        check_whole(arguments.bag)
        return
    fault = run(arguments)
    print_files(make_report(arguments.out / "belief", arguments.out, source_bag=arguments.bag))
    if fault is not None:
        raise fault


def run(arguments: Namespace) -> InputError | None:
    """The pipeline, from the bag to DIR/belief; returns what ended the input early. Raises InputError."""
    from semantic_slam.configuration import Configuration, from_dict, load_configuration, to_dict
    from semantic_slam.inference.map_prior import read_map_prior
    from semantic_slam.pipeline.offline import run_bag

    path = arguments.config or (DEFAULT_CONFIGURATION if DEFAULT_CONFIGURATION.is_file() else None)
    configuration = load_configuration(path) if path else Configuration()
    if arguments.seed is not None:
        configuration = from_dict({**to_dict(configuration), "seed": arguments.seed}, "--seed")
    prior = read_map_prior(arguments.map_prior) if arguments.map_prior else None
    summary = run_bag(arguments.bag, arguments.out / "belief", configuration, prior, arguments.max_keyframes)
    print(f"{summary.num_keyframes} keyframes of {summary.num_frames} frames")
    for reason, count in sorted(summary.dropped.items()):
        print(f"not used: {reason} ({count})")
    return summary.fault


def holds_beliefs(bag: Path) -> bool:
    """Whether a bag is a recorded belief; raises InputError when it cannot be read."""
    from semantic_slam.bag.reader import BagReader
    from semantic_slam.messages.topics import BELIEF

    with BagReader(bag) as reader:
        return BELIEF in reader.topics


def check_whole(bag: Path) -> None:
    """Raises InputError when a bag is damaged."""
    from semantic_slam.bag.reader import BagReader

    with BagReader(bag) as reader:
        for _ in reader.messages():
            pass


def print_files(files: list[Path]) -> None:
    for path in files:
        print(path)


def _announce_unused(arguments: Namespace) -> None:
    """A recorded belief is not computed again, so what steers a run has no effect."""
    for name in ("config", "seed", "max_keyframes", "map_prior"):
        if getattr(arguments, name) is not None:
            print(
                f"--{name.replace('_', '-')} has no effect: {arguments.bag} holds beliefs, which are not computed again"
            )


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
