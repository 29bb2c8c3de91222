"""``train_classifier --turntables DIR --out FILE``: the compact network, from turntable views of the objects."""

import argparse
import dataclasses
from pathlib import Path

from semantic_slam.cli.exit_codes import run_main
from semantic_slam.errors import InputError


def parse() -> argparse.Namespace:
    """The arguments; exits with code 2 on bad usage."""
    parser = argparse.ArgumentParser(
        prog="train_classifier", description="Train the compact network on turntable views (BigBIRD's format)."
    )
    parser.add_argument("--turntables", type=Path, required=True, help="folder with one folder per class")
    parser.add_argument("--out", type=Path, required=True, help="weights to write (.safetensors)")
    parser.add_argument("--epochs", type=int, help="passes over the drawn crops")
    parser.add_argument("--crops-per-epoch", type=int, help="crops drawn for each of them")
    parser.add_argument(
        "--max-azimuth-deg", type=float, help="views further from an object's front are not shown to the network"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of every random draw")
    return parser.parse_args()


def command() -> None:
    """Parse, train, save and say how well the network does around the objects. Raises InputError."""
    arguments = parse()
    import numpy as np

    from semantic_slam.perception.training import TrainingConfiguration, accuracy_by_azimuth, train
    from semantic_slam.perception.turntables import class_names_of, load_views
    from semantic_slam.perception.weights import save_compact_network

    limit = None if arguments.max_azimuth_deg is None else float(np.deg2rad(arguments.max_azimuth_deg))
    given = {
        "epochs": arguments.epochs,
        "crops_per_epoch": arguments.crops_per_epoch,
        "largest_azimuth_rad": limit,
        "seed": arguments.seed,
    }
    for name, value in given.items():
        if value is not None and value < (0 if name == "seed" else 1e-9):
            raise InputError(f"--{name.replace('_', '-')} {value}: must be positive; leave it out for the default")
    configuration = TrainingConfiguration(**{name: value for name, value in given.items() if value is not None})
    views = load_views(arguments.turntables)
    names = class_names_of(views)
    network = train(views, names, configuration)
    accuracy = accuracy_by_azimuth(network, views, names, configuration.seed)
    provenance = {"command": "train_classifier", "training": dataclasses.asdict(configuration), "accuracy": accuracy}
    save_compact_network(network, names, provenance, arguments.out)
    shares = ", ".join(f"{quarter} {share:.2f}" for quarter, share in accuracy.items())
    print(f"{arguments.out}: classes {', '.join(names)}; accuracy {shares}")


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
