"""Chapter 3: the class of one object, scores and track uncertain."""

from semantic_slam_lab.documentation.writing.methods_table import Column, MethodsTable
from semantic_slam_lab.documentation.writing.section import Section

CLASSIFIED = (
    Column("right at the end", "correct_rate_final"),
    Column("right on the way", "correct_rate_overall"),
    Column("log MGR, 95 %, end", "log_mgr_final_p95"),
    Column("on the way", "log_mgr_overall_p95"),
    Column("NLL", "nll"),
    Column("ECE", "ece"),
    Column("Brier", "brier"),
)
"""Metrics of chapter 3."""
CLASSIFIERS = {
    "ours": "joint (ours)",
    "recursive": "recursion (Alg. 3.1)",
    "model_based": "Model Based",
    "simple_bayes": "Simple Bayes",
}


def _classified(study: str, path: str = "methods", names: tuple[str, ...] = tuple(CLASSIFIERS)) -> MethodsTable:
    rows = {f"{path}/{name}": CLASSIFIERS[name] for name in names}
    return MethodsTable(study=study, columns=CLASSIFIED, rows=rows, first="method")


SECTIONS = (
    Section(
        "ch3_model_uncertainty",
        "Chapter 3: uncertain scores, known track",
        "Classification of one object from scores with model uncertainty (Figs. 3.2, 3.3), test noise σ_n.",
        (("", _classified("ch3_model_uncertainty")),),
    ),
    Section(
        "ch3_localization",
        "Chapter 3: certain scores, uncertain track",
        "The given scenario, one unknown offset for the whole track (Figs. 3.4, 3.5), test noise σ_n.",
        (("", _classified("ch3_localization")),),
    ),
    Section(
        "rendered_model_uncertainty",
        "Chapter 3: a real network in a rendered scene, known track",
        "Sec. 3.4.4.1 with the shipped network and dropout, test noise σ_n.",
        (("", _classified("rendered_model_uncertainty")),),
    ),
    Section(
        "rendered_localization",
        "Chapter 3: a real network, uncertain track",
        "Sec. 3.4.4.2, the hard track, test noise σ_n.",
        (("", _classified("rendered_localization", names=("ours", "recursive", "model_based"))),),
    ),
    Section(
        "avd_bigbird",
        "Chapter 3: AVD and BigBIRD layouts",
        "Sec. 3.4.5 on a simulated scene in the data sets' formats; `--avd SCENE --bigbird DIR` takes the real ones.",
        (("", _classified("avd_bigbird", names=("ours", "recursive", "model_based"))),),
    ),
)
