"""``fit_viewpoint_models --turntables DIR --out FILE``: class models of Eq. 4.2 from turntable views."""

import argparse
import json
import os
from pathlib import Path

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError


def parse() -> argparse.Namespace:
    """Arguments of the command line; raises InputError."""
    parser = CommandParser(
        prog="fit_viewpoint_models",
        description="Fit a Gaussian process per class and feature over the direction of view (BigBIRD's format).",
    )
    parser.add_argument("--turntables", type=Path, required=True, help="folder with one folder per class")
    parser.add_argument("--out", type=Path, required=True, help="model file to write (.safetensors)")
    parser.add_argument("--weights", type=Path, help="network to fit the models of; default: the shipped one")
    parser.add_argument(
        "--cameras",
        default="NP1,NP2,NP3,NP4",
        help="cameras of the turntable, low ones see as robots do (default: %(default)s)",
    )
    parser.add_argument(
        "--draws",
        type=int,
        default=8,
        help="crops per direction, each in another room and light (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of every random draw (default: %(default)s)")
    return parser.parse_args()


def command() -> None:
    """Parse, measure, fit and save; the report goes beside the model as JSON and in short to the terminal."""
    arguments = parse()
    if arguments.draws < 2:
        raise InputError(f"--draws {arguments.draws}: at least 2 are needed to see a spread")
    if arguments.seed < 0:
        raise InputError(f"--seed {arguments.seed}: must not be negative")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices gain nothing from threads
    from semantic_slam.perception.turntables import load_views

    views = load_views(arguments.turntables, tuple(arguments.cameras.split(",")))
    from semantic_slam.configuration import PerceptionConfiguration
    from semantic_slam.perception.weights import load_network
    from semantic_slam.viewpoint.fit import FitSettings, fit_models
    from semantic_slam.viewpoint.store import save_model

    classifier = load_network(PerceptionConfiguration(network=str(arguments.weights or "")))
    settings = FitSettings(draws=arguments.draws, seed=arguments.seed)
    model, report = fit_models(views, classifier, settings)
    provenance = {"command": "fit_viewpoint_models", "seed": settings.seed, "draws": settings.draws, "report": report}
    save_model(model, arguments.out, provenance)
    report_path = arguments.out.with_suffix(".json")
    report_path.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    for name, numbers in report.items():
        print(
            f"{name}: {numbers['coverage']['views']:.0f} directions, widest gap"
            f" {numbers['coverage']['widest_gap_deg']:.0f} deg, within 1 and 2 sigma"
            f" {numbers['fraction_within_1_sigma']:.2f} and {numbers['fraction_within_2_sigma']:.2f}, mean squared"
            f" whitened residual {numbers['mean_squared_whitened_residual']:.2f} of {model.num_features}"
        )
    print(f"{arguments.out}: {len(model.class_names)} classes; report in {report_path}")


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
