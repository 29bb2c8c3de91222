"""``semantic_slam fit --from-run DIR... --out FILE``: fit models of a detector's labels and embeddings.

They are learnt from the user's own runs: which labels the detector gives to objects, and how embeddings depend on the
viewing direction.
"""

import argparse
import json
from pathlib import Path

from semantic_slam.errors import InputError
from semantic_slam.outputs import claimed_files

OF_PICTURES = (
    *("weights", "config", "classes", "pattern", "mask_pattern"),
    *("cameras", "draws", "elevation_step_deg", "seed"),
)
"""Options of the other sources, which are refused with ``--from-run``."""


def learn_labels(arguments: argparse.Namespace) -> None:
    """Learn the models, write them with a report beside them, and print a summary. Raises InputError."""
    for name in OF_PICTURES:
        if getattr(arguments, name) is not None:
            raise InputError(f"--{name.replace('_', '-')}: is not for --from-run; leave it out")
    if arguments.out.suffix == ".json":
        raise InputError(f"{arguments.out}: is where the report goes; name a .safetensors file")
    outs = [arguments.out, arguments.out.with_suffix(".json")]
    with claimed_files(outs, arguments.from_run, arguments.overwrite) as (models, report):
        lines = _learn(arguments.from_run, models, report)
    print("\n".join(lines))
    print(f"{outs[0]}: report in {outs[1]}; name it as semantic_model.path in the next run's configuration")


def _learn(folders: list[Path], models: Path, report: Path) -> list[str]:
    from semantic_slam.training.from_run import learn_from
    from semantic_slam.training.runs import read_runs

    learned = learn_from(read_runs(folders))
    learned.save(models)
    report.write_text(json.dumps(learned.report, indent=1) + "\n", encoding="utf-8")
    return learned.lines
