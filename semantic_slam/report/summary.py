"""Many reports side by side: ``index.html`` and ``summary.json`` of a folder of reports, to sort and to compare."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from semantic_slam.inference.evidence.model_fit import UNEXPLAINED
from semantic_slam.inference.hypotheses import RECENT_KEYFRAMES
from semantic_slam.report.metrics_table import MEANINGS
from semantic_slam.report.plain_json import to_text
from semantic_slam.report.rendering import environment

EXISTS = 0.5
SHOWN_METRICS = ("ate_aligned_m", "nees_mean", "association_f1", "association_f1_annotated", "class_nll")


@dataclass(frozen=True, kw_only=True)
class SummaryRow:
    """One bag; what is not known is None."""

    name: str  # also the report's folder
    bag: str
    fault: str  # "" or what went wrong
    keyframes: int | None = None
    duration_s: float | None = None
    objects: int | None = None  # that exist with EXISTS or more
    hypotheses: int | None = None  # at the end
    unexplained: float | None = None  # share of the keyframes that state it whose data the belief does not explain
    discarded_mass: float | None = None  # since the start, without what was found again
    discarded_mass_window: float | None = None  # of the last keyframes; None in beliefs of older versions, too
    dropped: int | None = None  # messages and detections, for all reasons
    metrics: dict[str, float | int | None]  # SHOWN_METRICS, against the truth


def summary_row(name: str, bag: Path, folder: Path | None, fault: str) -> SummaryRow:
    """The row of one bag: from the report in ``folder``, None where none was made."""
    if folder is None:
        return SummaryRow(name=name, bag=str(bag), fault=fault, metrics={})
    document = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    keyframes: list[dict[str, Any]] = document["keyframes"]
    last = keyframes[-1]
    metrics = document.get("metrics", {})
    return SummaryRow(
        name=name,
        bag=str(bag),
        fault=fault,
        keyframes=len(keyframes),
        duration_s=(last["stamp_ns"] - keyframes[0]["stamp_ns"]) * 1e-9,
        objects=sum((own["existence"] or 0.0) >= EXISTS for own in document["objects"]),
        hypotheses=last["n_hypotheses"],
        unexplained=_share_unexplained(keyframes),
        discarded_mass=last["discarded_mass"],
        discarded_mass_window=last.get("discarded_mass_window"),
        dropped=sum(document["dropped"].values()),
        metrics={metric: metrics.get(metric) for metric in SHOWN_METRICS if metric in metrics},
    )


def _share_unexplained(keyframes: list[dict[str, Any]]) -> float | None:
    """Share of the keyframes that state ``unexplained`` whose data the belief does not explain; None if none does."""
    stated = [own["unexplained"] for own in keyframes if own.get("unexplained") is not None]
    return sum(own > UNEXPLAINED for own in stated) / len(stated) if stated else None


def summary_files(rows: Sequence[SummaryRow]) -> dict[str, str]:
    """The texts of ``index.html`` and ``summary.json``. Whatever comes from bags is escaped."""
    shown = [metric for metric in SHOWN_METRICS if any(metric in row.metrics for row in rows)]
    template = environment().get_template("summary.html")
    page = template.render(rows=rows, shown=shown, meanings=MEANINGS, recent_keyframes=RECENT_KEYFRAMES)
    return {"index.html": page, "summary.json": to_text({"schema_version": 1, "bags": [asdict(row) for row in rows]})}
