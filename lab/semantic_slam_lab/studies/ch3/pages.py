"""Words and tables that chapter 3's studies share."""

from collections.abc import Mapping
from typing import Any

from semantic_slam_lab.studies.result import Table

LINES = {
    "ours": "our default",
    "recursive": "the thesis's recursion",
    "recursive_per_component": "the recursion, per component",
    "joint": "joint process",
    "joint_per_component": "joint process, per component",
    "model_based": "Model Based",
    "simple_bayes": "Simple Bayes",
}
COLUMNS = {
    "correct_rate_final": "correct, final",
    "correct_rate_overall": "overall",
    "log_mgr_final_p75": "log MGR, final 75 %",
    "log_mgr_final_p95": "final 95 %",
    "log_mgr_overall_p75": "overall 75 %",
    "log_mgr_overall_p95": "overall 95 %",
    "msde_final": "MSDE, final",
    "nll": "NLL [nats]",
    "ece": "ECE",
    "brier": "Brier",
}


def methods_table(title: str, methods: Mapping[str, Mapping[str, Any]]) -> Table:
    """A row per method; one that is the default by another name has none of its own."""
    shown = {name: row for name, row in methods.items() if name == "ours" or row is not methods["ours"]}
    rows = tuple((label(name, row), *(number(row[column]) for column in COLUMNS)) for name, row in shown.items())
    return Table(title, ("method", *COLUMNS.values()), rows)


def label(name: str, row: Mapping[str, Any]) -> str:
    """A method's name in words, with what the default is."""
    return f"{LINES[name]} ({row['method'].replace('_', ' ')})" if name == "ours" else LINES[name]


def number(value: float) -> str:
    """Short and readable."""
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
