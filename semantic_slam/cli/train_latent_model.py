"""``train_latent_model --turntables DIR... --out FILE``: train a latent model (chapter 5) on turntable views."""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from semantic_slam.cli.exit_codes import CommandParser, program, run_main
from semantic_slam.cli.needs import need_training
from semantic_slam.cli.turntable_views import add_photographs, check_photographs, object_names, object_views
from semantic_slam.errors import InputError
from semantic_slam.interrupts import import_interruptibly
from semantic_slam.outputs import add_overwrite, check_output, claimed_file

if TYPE_CHECKING:
    from semantic_slam.training.latent.fit import TrainingSettings
    from semantic_slam.training.views import ObjectView

CLASSES_FILE = "classes.json"
NO_TAGS = "--tags: name none of the instances that are learned from; correct the names"
SHOWN = {
    "peak_within_10deg": "likelihood peak within 10 deg",
    "peak_within_5deg_local": "within 5 deg from starts within 30",
    "improved_from_18deg": "improved from 18 deg",
    "improved_from_25deg": "improved from 25 deg",
    "median_from_25deg_deg": "median error from there [deg]",
    "identification": "identified from one view",
    "identification_5_views": "from 5 views, orientation uncertain",
    "nees": "NEES",
    "nees_of_new": "of new objects",
    "nees_untempered": "untempered",
}


def parse() -> argparse.Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Learn a descriptor space and a viewpoint-dependent model over it from turntables (BigBIRD's"
        " format, one folder per instance, or photographs). No classes are needed; --tags grounds the space with some.",
    )
    parser.add_argument(
        "--turntables", type=Path, required=True, nargs="+", metavar="DIR", help="folders with one folder per instance"
    )
    add_photographs(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="model to write (.safetensors)")
    parser.add_argument(
        "--formulation",
        choices=("map", "energy"),
        default="map",
        help="joint posterior maximisation or energy minimisation (default: %(default)s)",
    )
    parser.add_argument(
        "--tags", type=Path, nargs="+", metavar="FILE", help="JSON {instance: class} of the instances with a tag"
    )
    parser.add_argument(
        "--shape-by-tags",
        action="store_true",
        help="let the tags take part in learning (map only); else they name regions of the finished space",
    )
    parser.add_argument(
        "--held-out", type=int, default=0, metavar="N", help="instances kept from training, to judge by (default: 0)"
    )
    parser.add_argument("--cameras", default="NP1,NP2,NP3,NP4,NP5", help="cameras to learn from (default: %(default)s)")
    parser.add_argument(
        "--new-objects",
        action="store_true",
        help="learn how wrong the model is about objects that it was not trained on: trains three times more, each time"
        " without a third of the instances",
    )
    parser.add_argument(
        "--effort", type=float, default=1.0, help="factor of the passes over the data (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of every random draw (default: %(default)s)")
    add_overwrite(parser)
    return parser.parse_args()


def command() -> None:
    """Parse, train, evaluate and save; the report is stored in the model and printed in short. Raises InputError."""
    arguments = parse()
    if not 0.0 < arguments.effort < math.inf or arguments.held_out < 0 or arguments.seed < 0:
        raise InputError(f"{program()}: --effort must be positive and finite, --held-out and --seed not negative")
    check_photographs(arguments, arguments.turntables)
    need_training()
    inputs = [*arguments.turntables, *(arguments.tags or ())]
    check_output(arguments.out, inputs, arguments.overwrite)
    import_interruptibly("torch")
    from semantic_slam.latent.store import save_latent_model
    from semantic_slam.training.latent.fit import TrainingSettings, knowing_new_instances, train
    from semantic_slam.training.latent.report import of_no_use, training_report
    from semantic_slam.training.latent.views.turntable_split import split
    from semantic_slam.training.turntables import class_names_of

    _check_instances(arguments)
    views, classes = _views(arguments)
    names = class_names_of(views)
    held_out = _held_out(arguments, names, classes)
    tags = _tags(arguments.tags or (), names, held_out)
    parts = split(views, held_out)
    settings = TrainingSettings(
        formulation=arguments.formulation, shaped_by_tags=arguments.shape_by_tags, seed=arguments.seed
    )
    settings = _with_effort(settings, arguments.effort)
    trained = train(parts, settings, tags or None)
    if arguments.new_objects:
        trained = knowing_new_instances(trained, parts, settings)
    report = training_report(trained, parts, arguments.seed)
    provenance = {
        "command": "train_latent_model",
        "arguments": {name: getattr(arguments, name) for name in ("formulation", "cameras", "effort", "seed")},
        "training": asdict(settings),
        "tagged": len(tags),
        "held_out": list(held_out),
        "report": report,
    }
    state = {name: value.numpy() for name, value in trained.extractor.state_dict().items()}
    with claimed_file(arguments.out, inputs, arguments.overwrite) as out:
        save_latent_model(replace(trained.model, provenance=provenance), state, out)
    for place, groups in report.items():
        for group, figures in groups.items():
            shown = ", ".join(f"{text} {figures[name]:.3f}" for name, text in SHOWN.items() if name in figures)
            print(f"{place}, {group}: {shown}")
    for line in of_no_use(report):
        print(line, file=sys.stderr)
    print(f"{arguments.out}: {len(trained.model.instances.names)} instances, {len(held_out)} held out")


def _check_instances(arguments: argparse.Namespace) -> None:
    """Raise InputError where the turntables cannot have the instances that are asked for; reads no picture."""
    from semantic_slam.training.turntables import classes_of_folders, read_classes

    names = sorted({name for root in arguments.turntables for name in object_names(arguments, root)})
    classes, _ = classes_of_folders(_classes_files(arguments), names)
    _held_out(arguments, names, classes)
    if arguments.tags and not any(name in read_classes(path) for path in arguments.tags for name in names):
        raise InputError(NO_TAGS)


def _held_out(arguments: argparse.Namespace, names: Sequence[str], classes: Mapping[str, str]) -> tuple[str, ...]:
    """Instances that nothing is fitted to; raises InputError when too few are left."""
    from semantic_slam.training.latent.judging.new_instances import LEAST_INSTANCES
    from semantic_slam.training.latent.views.turntable_split import choose_held_out

    held_out = choose_held_out(names, classes, arguments.held_out, arguments.seed)
    left = len(names) - len(held_out)
    if arguments.new_objects and left < LEAST_INSTANCES:
        raise InputError(f"--new-objects: needs {LEAST_INSTANCES} instances to learn from, not {left}; leave it out")
    return held_out


def _classes_files(arguments: argparse.Namespace) -> list[Path]:
    return [root / CLASSES_FILE for root in arguments.turntables if (root / CLASSES_FILE).is_file()]


def _views(arguments: argparse.Namespace) -> "tuple[list[ObjectView], dict[str, str]]":
    """Views of all folders, and {instance: class} from their classes.json, if any; raises InputError.

    Names in these files that no turntable has are told, and so are instances that none of the files names.
    """
    from semantic_slam.training.latent.views.turntable_split import wanted_angle
    from semantic_slam.training.turntables import class_names_of, classes_of_folders

    views = [view for root in arguments.turntables for view in object_views(arguments, root, wanted_angle)]
    classes, lines = classes_of_folders(_classes_files(arguments), class_names_of(views))
    for line in lines:
        print(line, file=sys.stderr)
    return views, classes


def _tags(paths: Sequence[Path], names: Sequence[str], held_out: Sequence[str]) -> dict[str, str]:
    """{instance: class} of the instances that are learned from; names that no turntable has are told.

    Raises InputError when there are files that name none of these instances.
    """
    from semantic_slam.training.turntables import read_classes, unknown_names

    tags = {}
    for path in paths:
        of_file = read_classes(path)
        for line in unknown_names(path, of_file, names):
            print(line, file=sys.stderr)
        tags.update(of_file)
    known = {name: tags[name] for name in names if name in tags and name not in held_out}
    if paths and not known:
        raise InputError(NO_TAGS)
    return known


def _with_effort(settings: "TrainingSettings", effort: float) -> "TrainingSettings":
    """Settings with the numbers of epochs and steps multiplied by ``effort``, at least 1 each."""
    names = ("regression_epochs", "contrast_epochs", "energy_epochs", "decoder_steps", "encoder_steps", "change_steps")
    return replace(settings, **{name: max(round(effort * getattr(settings, name)), 1) for name in names})


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
