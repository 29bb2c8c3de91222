"""``train_classifier --turntables DIR --out FILE``: train a classifier on turntable views of the objects.

It is the compact network, or with ``--config YAML`` a head on the frozen ImageNet network of a configuration.
"""

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semantic_slam.cli.exit_codes import CommandParser, program, run_main
from semantic_slam.cli.turntable_views import add_photographs, check_photographs, in_classes, object_views
from semantic_slam.errors import InputError
from semantic_slam.interrupts import import_interruptibly
from semantic_slam.outputs import add_overwrite, check_output, claimed_file
from semantic_slam.shipped import configuration_file

if TYPE_CHECKING:
    from semantic_slam.perception.networks.network import DropoutNetwork
    from semantic_slam.training.views import ObjectView


def parse() -> argparse.Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Train the compact network on turntable views (BigBIRD's format, or photographs), or with --config"
        " a head for their classes on a frozen ImageNet network. The file goes into the next run's configuration as"
        " perception.network, or as perception.head. Every fifth angle of each class is held out from the training, to"
        " state the accuracy of.",
    )
    parser.add_argument(
        "--turntables", type=Path, required=True, help="folder with one folder per class, or photographs"
    )
    add_photographs(parser)
    parser.add_argument("--out", type=Path, required=True, help="weights to write (.safetensors)")
    parser.add_argument(
        "--config",
        type=configuration_file,
        metavar="YAML",
        help="configuration whose section perception names an ImageNet network: train a head on it",
    )
    parser.add_argument("--cameras", default="NP1,NP2,NP3,NP4,NP5", help="cameras to learn from (default: %(default)s)")
    parser.add_argument(
        "--epochs", type=int, help="passes over the drawn crops (default: 14), with --config (default: 150)"
    )
    parser.add_argument(
        "--crops-per-epoch",
        type=int,
        help="crops drawn for each of them (default: 4000), with --config once for all of them (default: 2000)",
    )
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
    """Parse, train, save, and print the network's accuracy on held-out views. Raises InputError."""
    arguments = parse()
    chosen = _chosen(arguments)
    check_photographs(arguments, [arguments.turntables])
    inputs = [arguments.turntables, arguments.config, arguments.classes]
    check_output(arguments.out, inputs, arguments.overwrite)
    trunk = _trunk(arguments.config) if arguments.config else None  # before the views, which take long to read
    from semantic_slam.training.turntables import class_names_of

    views = in_classes(arguments, object_views(arguments, arguments.turntables))
    names = class_names_of(views)
    trained = _trained(views, names, trunk, chosen)
    with claimed_file(arguments.out, inputs, arguments.overwrite) as out:
        trained.save({"command": "train_classifier", **trained.provenance}, out)
    print(f"{arguments.out}: classes {', '.join(names)}; {_accuracy(**trained.provenance['held_out'])}")


def _accuracy(views: int, accuracy: dict[str, float]) -> str:
    """The accuracy in words."""
    if not views:
        return "accuracy not measured: no class was seen from five angles, of which one would be held out"
    shares = ", ".join(f"{quarter} {share:.2f}" for quarter, share in accuracy.items())
    return f"accuracy on {views} held-out views (every fifth angle): {shares}"


@dataclass(frozen=True)
class Trained:
    """What a training has come to."""

    save: Callable[[dict[str, object], Path], None]  # writes it to a file, with a provenance
    provenance: dict[str, Any]  # "training": settings, "held_out": number of views and accuracy by quarter around


def _trained(
    views: "Sequence[ObjectView]", names: tuple[str, ...], trunk: "DropoutNetwork | None", chosen: dict[str, Any]
) -> Trained:
    """A head on the trunk, or the compact network without one, judged by views held out. Raises InputError."""
    import_interruptibly("torch")
    from semantic_slam.perception.networks.head import save_head
    from semantic_slam.perception.networks.weights import save_compact_network
    from semantic_slam.training.classifier import (
        TrainingConfiguration,
        accuracy_by_azimuth,
        hold_out_angles,
        shown_views,
        train,
    )
    from semantic_slam.training.head import HEAD_TRAINING, train_on_trunk

    configuration = replace(TrainingConfiguration() if trunk is None else HEAD_TRAINING, **chosen)
    learned, held_out = hold_out_angles(shown_views(views, names, configuration))
    if trunk is None:
        compact = train(learned, names, configuration)
        network: DropoutNetwork = compact
        save = partial(save_compact_network, compact, names)
    else:
        classifier = train_on_trunk(learned, names, trunk, configuration)
        network, save = classifier.network, partial(save_head, classifier)
    accuracy = accuracy_by_azimuth(network, held_out, names, configuration.seed)
    judged = {"views": len(held_out), "accuracy": accuracy}
    return Trained(save, {"training": asdict(configuration), "held_out": judged})


def _trunk(path: Path) -> "DropoutNetwork":
    """The ImageNet network of a configuration. Raises InputError."""
    from semantic_slam.configuration import load_configuration

    settings = load_configuration(path).perception
    import_interruptibly("torch")
    from semantic_slam.perception.networks.imagenet_networks import load_trunk

    return load_trunk(settings)


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
