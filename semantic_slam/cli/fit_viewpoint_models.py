"""``fit_viewpoint_models SOURCE --out FILE``: fit class models over the viewing direction.

SOURCE is one of ``--turntables DIR``, ``--avd SCENE``, ``--bag BAG`` and ``--from-run DIR…``.
"""

import argparse
import json
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.cli.fit_label_models import learn_labels
from semantic_slam.cli.needs import need_training
from semantic_slam.cli.turntable_views import add_photographs, check_photographs, in_classes, object_views
from semantic_slam.errors import InputError
from semantic_slam.interrupts import import_interruptibly
from semantic_slam.outputs import add_overwrite, claimed_files
from semantic_slam.shipped import configuration_file

if TYPE_CHECKING:
    from semantic_slam.configuration import PerceptionConfiguration

DEFAULTS = {"cameras": "NP1,NP2,NP3,NP4", "draws": 8, "elevation_step_deg": 0.0, "seed": 0}
"""Values of options that are not given; ``--from-run`` refuses those that are."""
OF_TURNTABLES = ("classes", "cameras", "draws", "elevation_step_deg")
"""Options for ``--turntables`` alone."""


def parse() -> argparse.Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Fit class models over the direction of view: a Gaussian process per class and feature of a"
        " classifier of ours (--turntables, --avd, --bag), or what a detector of yours confuses (--from-run). The"
        " file goes into the next run's configuration as semantic_model.path.",
    )
    _add_source(parser)
    add_photographs(parser)
    parser.add_argument("--out", type=Path, required=True, help="model file to write (.safetensors)")
    _add_network(parser)
    _add_views(parser)
    parser.add_argument("--seed", type=int, help=f"seed of every random draw (default: {DEFAULTS['seed']})")
    add_overwrite(parser)
    return parser.parse_args()


def _add_source(parser: CommandParser) -> None:
    """Add what the models are fitted to, one of four."""
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "--turntables", type=Path, help="folder with one BigBIRD-format folder per class, or photographs"
    )
    source.add_argument("--avd", type=Path, metavar="SCENE", help="AVD-format scene: views along a drive through it")
    source.add_argument("--bag", type=Path, help="bag with images, detections and the /ground_truth topics")
    source.add_argument(
        "--from-run",
        type=Path,
        nargs="+",
        metavar="DIR",
        help="folders of reports of runs with semantic_model.kind: detector or embedding: what a detector calls things"
        " from where, or how looks change by direction, learned from beliefs, without anybody's labels",
    )


def _add_network(parser: CommandParser) -> None:
    """Add the network whose scores the models describe."""
    network = parser.add_mutually_exclusive_group()
    network.add_argument(
        "--weights", type=Path, help="network of train_classifier to fit the models of; default: the shipped one"
    )
    network.add_argument(
        "--config",
        type=configuration_file,
        metavar="YAML",
        help="configuration of the runs that are to use the models: its section perception names network, classes and"
        " dropout passes",
    )


def _add_views(parser: CommandParser) -> None:
    """Add which views of turntables are used, and for which classes."""
    parser.add_argument(
        "--cameras",
        help=f"cameras of the turntable, low ones see as robots do (default: {DEFAULTS['cameras']})",
    )
    parser.add_argument(
        "--draws",
        type=int,
        help=f"crops per direction, each in another room and light (default: {DEFAULTS['draws']})",
    )
    parser.add_argument(
        "--elevation-step-deg",
        type=float,
        help="tell views of turntables apart by elevation, too, in such steps (default: 0, by azimuth alone)",
    )
    parser.add_argument(
        "--classes",
        type=Path,
        metavar="FILE",
        help="JSON {instance: class} for turntables of instances; default: each turntable is a class",
    )


def command() -> None:
    """Parse and fit; output files are either complete or not written. Raises InputError."""
    arguments = parse()
    if arguments.from_run:
        learn_labels(arguments)
        return
    _check_source(arguments)
    _fill_in(arguments)
    _check_values(arguments)
    need_training()
    if arguments.out.suffix in (".json", ".html"):
        raise InputError(f"{arguments.out}: is where the report goes; name a .safetensors file")
    outs = [arguments.out.with_suffix(suffix) for suffix in (arguments.out.suffix, ".json", ".html")]
    inputs = [getattr(arguments, name) for name in ("turntables", "avd", "bag", "weights", "config", "classes")]
    with claimed_files(outs, inputs, arguments.overwrite) as staged:
        lines = fit(arguments, *staged)
    print("\n".join(lines))
    print(f"{outs[0]}: report in {outs[1]} and {outs[2]}")


def _check_source(arguments: argparse.Namespace) -> None:
    """Raises InputError for options that the source has no use for."""
    for name in OF_TURNTABLES:
        if getattr(arguments, name) is not None and not arguments.turntables:
            raise InputError(f"--{name.replace('_', '-')}: only for --turntables; leave it out")
    check_photographs(arguments, [arguments.turntables] if arguments.turntables else [])


def _check_values(arguments: argparse.Namespace) -> None:
    """Raises InputError for numbers out of range."""
    if arguments.draws < 2:
        raise InputError(f"--draws {arguments.draws}: at least 2 are needed to see a spread")
    if not 0.0 <= arguments.elevation_step_deg <= 90.0:
        raise InputError(f"--elevation-step-deg {arguments.elevation_step_deg}: must lie in 0 to 90")
    if arguments.seed < 0:
        raise InputError(f"--seed {arguments.seed}: must not be negative")


def _fill_in(arguments: argparse.Namespace) -> None:
    """Give options that are not given their defaults."""
    for name, value in DEFAULTS.items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, value)


def fit(arguments: argparse.Namespace, model_path: Path, report_path: Path, page: Path) -> list[str]:
    """Measure, fit and save model, JSON report and page; returns the lines of a short report."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices gain nothing from threads
    perception = _perception(arguments)
    import_interruptibly("torch")
    from semantic_slam.perception.networks.digest import network_digest
    from semantic_slam.perception.networks.weights import is_shipped, load_network
    from semantic_slam.training.viewpoint.fit import appearance_of, fit_samples
    from semantic_slam.training.viewpoint.page import write_page
    from semantic_slam.viewpoint.store import save_model

    network = load_network(perception)  # before the views, which take long to read
    samples, left_out = _samples(arguments, perception, network)
    fitted = fit_samples(samples, network.class_names)
    model, report = fitted.model, fitted.report
    provenance = {
        "command": "fit_viewpoint_models",
        "seed": arguments.seed,
        "draws": arguments.draws,
        "report": report,
        "left_out": left_out,
    }
    appearance = appearance_of(samples, network)
    digest = "" if is_shipped(perception) else network_digest(network)
    save_model(model, model_path, provenance, appearance, digest)
    report_path.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    write_page(page, fitted, samples)
    lines = [f"left out: {reason} ({count})" for reason, count in sorted(left_out.items())]
    for name, numbers in report.items():
        lines.append(
            f"{name}: {numbers['coverage']['views']:.0f} directions, widest gap"
            f" {numbers['coverage']['widest_gap_deg']:.0f} deg; {numbers['left_out']} left out: within 1 and 2 sigma"
            f" {numbers['fraction_within_1_sigma']:.2f} and {numbers['fraction_within_2_sigma']:.2f}, mean squared"
            f" whitened residual {numbers['mean_squared_whitened_residual']:.2f} of {model.num_features}"
        )
    if appearance is None:
        lines.append("pictures of other things: not told, for lack of turntable views")
    return [*lines, f"{len(model.class_names)} classes"]


def _perception(arguments: argparse.Namespace) -> "PerceptionConfiguration":
    """Perception of ``--config``, else with the network of ``--weights`` or the shipped one. Raises InputError."""
    from semantic_slam.class_models.kind import class_model_kind
    from semantic_slam.configuration import PerceptionConfiguration, load_configuration

    if not arguments.config:
        return PerceptionConfiguration(network=str(arguments.weights or ""))
    configuration = load_configuration(arguments.config)
    kind = class_model_kind(configuration.semantic_model)
    if kind.labels is not None or kind.embeddings is not None or kind.descriptors is not None:
        raise InputError(
            f"{arguments.config}: semantic_model.kind: {configuration.semantic_model.kind} uses no network's scores;"
            " set kind: gp_independent or gp_correlated"
        )
    return configuration.perception


def _samples(
    arguments: argparse.Namespace, perception: "PerceptionConfiguration", network: Any
) -> tuple[dict[str, Any], dict[str, int]]:
    """Samples by class name from the given source, and the counts of what was left out, by reason."""
    if arguments.turntables:
        from semantic_slam.training.viewpoint.fit import FitSettings, measure_views, with_enough_directions

        views = in_classes(arguments, object_views(arguments, arguments.turntables))
        settings = FitSettings(
            draws=arguments.draws,
            num_passes=perception.num_passes,
            seed=arguments.seed,
            elevation_step_deg=arguments.elevation_step_deg,
        )
        views, left_out = with_enough_directions(views, settings)
        return measure_views(views, network, settings), left_out
    from semantic_slam.training.viewpoint.known_poses import views_of_bag

    if arguments.bag:
        return views_of_bag(arguments.bag, perception)
    from semantic_slam.datasets.avd.avd_import import import_avd

    with TemporaryDirectory() as folder:
        import_avd(arguments.avd, Path(folder) / "drive", seed=arguments.seed)
        return views_of_bag(Path(folder) / "drive", perception)


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
