"""``semantic_slam fit --from-run DIR... --out FILE``: fit models of a detector's labels or of its embeddings.

They are learnt from the user's own runs: which labels the detector gives to objects, or how embeddings depend on the
viewing direction.
"""

import argparse
import json
from pathlib import Path

from semantic_slam.errors import InputError
from semantic_slam.outputs import claimed_files

OF_PICTURES = ("weights", "config", "classes", "pattern", "mask_pattern")
"""Options of the other sources, which are refused with ``--from-run``."""


def learn_labels(arguments: argparse.Namespace) -> None:
    """Learn the models, write them with a report beside them, and print a summary. Raises InputError."""
    for name in OF_PICTURES:
        if getattr(arguments, name, None):
            raise InputError(f"--{name.replace('_', '-')}: is not for --from-run; leave it out")
    if arguments.out.suffix == ".json":
        raise InputError(f"{arguments.out}: is where the report goes; name a .safetensors file")
    outs = [arguments.out, arguments.out.with_suffix(".json")]
    with claimed_files(outs, arguments.from_run, arguments.overwrite) as (models, report):
        lines = _learn(arguments.from_run, models, report)
    print("\n".join(lines))
    print(f"{outs[0]}: report in {outs[1]}; name it as semantic_model.path in the next run's configuration")


def _learn(folders: list[Path], models: Path, report: Path) -> list[str]:
    from semantic_slam.class_models.kind import class_model_kind
    from semantic_slam.training.embeddings.learn import learn_embeddings
    from semantic_slam.training.embeddings.learn import lines_of as lines_of_looks
    from semantic_slam.training.labels.learn import RunTracks, learn
    from semantic_slam.training.labels.report import lines_of
    from semantic_slam.training.labels.runs import read_runs
    from semantic_slam.viewpoint.embeddings.store import save_embeddings
    from semantic_slam.viewpoint.labels.store import save_labels

    runs = read_runs(folders)
    if class_model_kind(runs[0].configuration.semantic_model).labels is None:
        looks = learn_embeddings(runs)
        save_embeddings(looks, models)
        report.write_text(json.dumps(looks.report, indent=1) + "\n", encoding="utf-8")
        return lines_of_looks(looks)
    fitted = learn(RunTracks.of(runs))
    save_labels(fitted, models)
    report.write_text(json.dumps(fitted.report, indent=1) + "\n", encoding="utf-8")
    return lines_of(fitted.report)
