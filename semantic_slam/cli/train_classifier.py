"""``train_classifier --turntables DIR --out FILE``: train the compact network on turntable views of the objects."""

import argparse
import dataclasses
import math
from pathlib import Path
from typing import Any

from semantic_slam.cli.exit_codes import CommandParser, program, run_main
from semantic_slam.cli.turntable_views import add_photographs, check_photographs, object_views
from semantic_slam.errors import InputError
from semantic_slam.interrupts import import_interruptibly
from semantic_slam.outputs import add_overwrite, check_output, claimed_file


def parse() -> argparse.Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Train the compact network on turntable views (BigBIRD's format, or photographs)."
    )
    parser.add_argument(
        "--turntables", type=Path, required=True, help="folder with one folder per class, or photographs"
    )
    add_photographs(parser)
    parser.add_argument("--out", type=Path, required=True, help="weights to write (.safetensors)")
    parser.add_argument("--cameras", default="NP1,NP2,NP3,NP4,NP5", help="cameras to learn from (default: %(default)s)")
    parser.add_argument("--epochs", type=int, help="passes over the drawn crops (default: 14)")
    parser.add_argument("--crops-per-epoch", type=int, help="crops drawn for each of them (default: 4000)")
    parser.add_argument(
        "--max-azimuth-deg",
        type=float,
        help="views further from an object's front are not shown to the network (default: 109)",
    )
    parser.add_argument(
        "--classes",
        type=Path,
        metavar="FILE",
        help="JSON {instance: class} for turntables of instances; default: each turntable is a class",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of every random draw (default: %(default)s)")
    add_overwrite(parser)
    return parser.parse_args()


def command() -> None:
    """Parse, train, save, and print the network's accuracy by azimuth. Raises InputError."""
    arguments = parse()
    chosen = _chosen(arguments)
    check_photographs(arguments, [arguments.turntables])
    inputs = [arguments.turntables, arguments.classes]
    check_output(arguments.out, inputs, arguments.overwrite)
    from semantic_slam.training.turntables import class_names_of, with_classes

    views = object_views(arguments, arguments.turntables)
    if arguments.classes:
        views = with_classes(views, arguments.classes)
    import_interruptibly("torch")
    from semantic_slam.perception.networks.weights import save_compact_network
    from semantic_slam.training.classifier import TrainingConfiguration, accuracy_by_azimuth, train

    configuration = TrainingConfiguration(**chosen)
    names = class_names_of(views)
    network = train(views, names, configuration)
    accuracy = accuracy_by_azimuth(network, views, names, configuration.seed)
    training = dataclasses.asdict(configuration)
    provenance: dict[str, object] = {"command": "train_classifier", "training": training, "accuracy": accuracy}
    with claimed_file(arguments.out, inputs, arguments.overwrite) as out:
        save_compact_network(network, names, provenance, out)
    shares = ", ".join(f"{quarter} {share:.2f}" for quarter, share in accuracy.items())
    print(f"{arguments.out}: classes {', '.join(names)}; accuracy {shares}")


def _chosen(arguments: argparse.Namespace) -> dict[str, Any]:
    """Fields of the training configuration set on the command line; raises InputError for invalid ones."""
    limit = arguments.max_azimuth_deg
    fields = {
        "epochs": arguments.epochs,
        "crops_per_epoch": arguments.crops_per_epoch,
        "largest_azimuth_rad": None if limit is None else math.radians(limit),
    }
    chosen = {name: value for name, value in fields.items() if value is not None}
    for name, value in chosen.items():
        if value <= 0:
            raise InputError(f"{program()}: {name} must be positive, not {value}; leave it out for the default")
    if arguments.seed < 0:
        raise InputError(f"{program()}: --seed {arguments.seed} must not be negative")
    return {**chosen, "seed": arguments.seed}


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
