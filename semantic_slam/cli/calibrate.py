"""``semantic_slam calibrate BAG --out DIR``: find the configuration that maximises the evidence of a bag."""

from argparse import Namespace
from pathlib import Path

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError
from semantic_slam.outputs import add_overwrite, claimed_folder
from semantic_slam.shipped import configuration_file

CONFIGURATION, PAGE = "calibrated.yaml", "calibration.html"


def parse(words: list[str] | None = None) -> Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Run a bag again and again to find the noise under which its detections are likeliest: of odometry,"
        " of detections, what of it repeats, and clutter, a factor of two at a time; then what the best run has"
        " inferred. No ground truth is needed, and none is used; where the bag has it, the page says how far off the"
        f" result is. Writes DIR/{CONFIGURATION} and DIR/{PAGE}.",
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 folder, .mcap or .db3")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the two files")
    parser.add_argument(
        "--config",
        type=configuration_file,
        default="uncalibrated",
        metavar="YAML",
        help="where to begin: file, or the name of a shipped configuration (default: %(default)s)",
    )
    parser.add_argument("--max-keyframes", type=int, metavar="N", help="use the first N keyframes of the bag alone")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="runs at a time (default: %(default)s)")
    parser.add_argument(
        "--map-prior", type=Path, metavar="MAP", help="FILE.map or objects.json (default: objects.json beside BAG)"
    )
    add_overwrite(parser)
    arguments = parser.parse_args(words)
    for name in ("max_keyframes", "jobs"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            raise InputError(f"--{name.replace('_', '-')} {value}: must be at least 1; correct the number")
    return arguments


def command() -> None:
    """Parse, calibrate, write; raises InputError, for a damaged bag after the files have been written."""
    arguments = parse()
    inputs = [arguments.bag, arguments.config, arguments.map_prior]
    with claimed_folder(arguments.out, inputs, arguments.overwrite) as out:
        damage = write(arguments, out)
    for name in (CONFIGURATION, PAGE):
        print(arguments.out / name)
    if damage:
        raise InputError(damage)


def write(arguments: Namespace, out: Path) -> str:
    """Calibrate and write both files into ``out``; returns what ended the input early. Raises InputError."""
    from tempfile import TemporaryDirectory

    from semantic_slam.calibration.calibrate import calibrate
    from semantic_slam.calibration.configuration_file import configuration_text
    from semantic_slam.calibration.page import render_page
    from semantic_slam.calibration.trial import Drive
    from semantic_slam.configuration import load_configuration
    from semantic_slam.maps.map_file import read_map_prior

    configuration = load_configuration(arguments.config)
    prior = read_map_prior(arguments.map_prior) if arguments.map_prior else None
    drive = Drive(bag=arguments.bag, map_prior=prior, max_keyframes=arguments.max_keyframes)
    with TemporaryDirectory() as scratch:
        found = calibrate(drive, configuration, Path(scratch), arguments.jobs)
        texts = {CONFIGURATION: configuration_text(found, arguments.config.name)}
        texts[PAGE] = render_page(found, arguments.config.name)
    out.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
    for name, change in found.changes.items():
        print(f"{name}: {change.before} -> {change.after} ({change.gain:+.1f} nats)")
    print(f"{found.gain:+.1f} nats over {found.first.num_keyframes} keyframes")
    return found.first.damage


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
