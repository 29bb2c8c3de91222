"""Questions by vector and by text, and association by vectors."""

from typing import Any

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "embeddings"
VECTORS = {"drawn": "drawn", "squeezenet": "photographs"}
METHODS = {"ours": "ours", "cosine": "softmax of cosines"}
SCORES = (("num_questions", ",.0f"), ("right", ".1%"), ("ece", ".3f"), ("nll", ".2f"))
SCORE_NAMES = ("questions", "right", "ECE", "NLL")


def by_vector(results: KeptResults) -> str:
    """Questions to a map that was made in passes of a kind, by the group of the question."""
    rows = [
        (VECTORS[network], passes, METHODS[method], group, *_cells(own))
        for network, part in _galleries(results).items()
        for passes, methods in part["passes"].items()
        for method, groups in methods.items()
        for group, own in groups.items()
    ]
    return table(("vectors", "passed", "method", "asked for", *SCORE_NAMES), rows)


def in_rooms(results: KeptResults) -> str:
    """Association in rooms, with vectors and without."""
    rows = [
        (
            VECTORS[network],
            method,
            value(own["association_f1"], ".3f"),
            value(own["num_objects"], ".1f"),
            value(own["num_true_objects"], ".1f"),
        )
        for network, part in _galleries(results).items()
        for method, own in part["methods"].items()
        if method != "ours"
    ]
    return table(("vectors", "`semantic_model.kind`", "association F1", "objects", "true ones"), rows)


def asked_in_rooms(results: KeptResults) -> str:
    """Questions to the maps of those rooms, whose associations may be wrong."""
    rows = [
        (VECTORS[network], group, *_cells(own))
        for network, part in _galleries(results).items()
        for group, own in part["room_questions"].items()
    ]
    return table(("vectors", "asked for", *SCORE_NAMES), rows)


def by_text(results: KeptResults) -> str:
    """Questions by named text vectors."""
    rows = [
        (name, value(own["right_mapped"], ".1%"), value(own["right_not_mapped"], ".1%"), value(own["ece"], ".3f"))
        for name, own in results.results[STUDY]["texts"].items()
    ]
    return table(("texts point at what they name", "right, mapped", "right, not mapped", "ECE"), rows)


def _galleries(results: KeptResults) -> dict[str, Any]:
    found: dict[str, Any] = results.results[STUDY]["galleries"]
    return found


def _cells(own: dict[str, float]) -> tuple[str, ...]:
    return tuple(value(own[name], style) for name, style in SCORES)


SECTIONS = (
    Section(
        STUDY,
        "Vectors of appearance",
        "`find_objects` by a vector or a named text vector (`semantic_slam find --vector`, `--text-vectors`), and"
        " `semantic_model.kind: embedding`. Nothing is fitted. *drawn*: vectors in a narrow cone, as those of large"
        " networks; *photographs*: the trunk features of SqueezeNet for COIL-100, in place of CLIP's. Asked for are"
        " views that the map has not seen, *between* its views or from *elsewhere*, and things that are *not mapped*."
        " *passed*: how far the robot went around each thing; *softmax of cosines*: of the largest cosine with each"
        " object's views, as CLIP's classifiers have it, which knows of nothing that is not there.",
        (
            ("By vector, associations known", by_vector),
            ("Rooms, associations unknown", in_rooms),
            ("By vector, in those rooms", asked_in_rooms),
            ("By text, drawn vectors", by_text),
        ),
    ),
)
