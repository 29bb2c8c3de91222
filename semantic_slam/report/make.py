"""From a recorded belief bag to the files of a report."""

import json
from collections.abc import Mapping
from pathlib import Path

from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.record import json_object
from semantic_slam.outputs import write_whole
from semantic_slam.report.comparison import Run, comparison_rows
from semantic_slam.report.document import Analysis, analyse, objects_document, report_document, tum_lines
from semantic_slam.report.page import render_page
from semantic_slam.report.plain_json import to_text
from semantic_slam.report.shown.evidence import evidence_of


def make_report(
    belief_bag: Path,
    out: Path,
    source_bag: Path | None = None,
    name: str = "this run",
    compared: Mapping[str, Path] | None = None,
    *,
    with_evidence: bool = False,
) -> list[Path]:
    """Write ``report.json``, ``objects.json``, ``trajectory.tum`` and ``report.html`` into the folder ``out``.

    Nothing is inferred anew, unless ``with_evidence`` is to tell why objects are what they are. Pictures come from
    ``source_bag``, else from the bag that the run configuration names, when it is still there. ``compared`` are belief
    bags of the same input by the names of their runs, which the report sets beside this one, called ``name``. Returns
    the paths written. Raises InputError when a bag holds no beliefs.
    """
    runs = [Run(run_name, _analysis(path)) for run_name, path in {name: belief_bag, **(compared or {})}.items()]
    analysis, record = runs[0].analysis, runs[0].analysis.record
    document = report_document(analysis) | {"comparisons": comparison_rows(runs)}
    explained = evidence_of(analysis, belief_bag) if with_evidence else []
    texts = {
        "report.json": to_text(document),
        "objects.json": json.dumps(objects_document(record), indent=1) + "\n",
        "trajectory.tum": tum_lines(analysis),
        "report.html": render_page(runs, source_bag or _named_source(record.run.source), explained),
    }
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            write_whole(out / name, text)
    except OSError as fault:
        raise InputError(f"{out}: cannot be written ({fault.strerror}); name another output folder") from None
    return [out / name for name in texts]


def _analysis(belief_bag: Path) -> Analysis:
    return analyse(read_record(belief_bag), belief_bag, BagReader(belief_bag).sha256())


def _named_source(source: str) -> Path | None:
    path = json_object(source).get("path")
    return Path(str(path)) if path else None
