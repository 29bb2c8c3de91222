"""Photographs on turntables: chapters 3 and 5 on real pictures."""

from collections.abc import Mapping
from typing import Any

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.methods_table import Column, MethodsTable
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "real_turntables"
METHODS = {
    "ours": "ours",
    "recursive": "the thesis's recursion",
    "model_based": "Model Based",
    "simple_bayes": "Simple Bayes",
}
UNCERTAINTIES = {"model": "exact", "localisation_10cm": "off by 10 cm", "localisation_20cm": "off by 20 cm"}
FORMULATIONS = {"map": "MAP", "energy": "energy"}
CLASSIFICATION = (
    Column("right at the end", "correct_rate_final", ".3f"),
    Column("overall", "correct_rate_overall", ".3f"),
    Column("log MGR 95 %, end", "log_mgr_final_p95", ".3g"),
    Column("overall", "log_mgr_overall_p95", ".3g"),
    Column("NLL", "nll", ".4f"),
    Column("ECE", "ece", ".3f"),
)
LATENT = (
    Column("peak within 10°", "peak_within_10deg", ".1%"),
    Column("objects told", "objects_told", "d"),
    Column("NEES", "nees"),
    Column("one view by lot in its band", "nees_one_view_in_band", ".0%"),
    Column("instance, one view", "instance_1_view", ".1%"),
    Column("new objects: peak", "new_peak_within_10deg_widened", ".0%"),
    Column("NEES", "new_nees"),
    Column("widened", "new_nees_widened"),
    Column("classes by two tags", "grounding/nearest_3_views", ".0%"),
    Column("supervised by them", "grounding/supervised_3_views", ".0%"),
)


def untold(results: KeptResults) -> str:
    """Objects whose azimuth a nearest neighbour does not tell, under MAP."""
    objects: Mapping[str, Any] = results.at(f"{STUDY}:latent/map/objects")
    rows = [
        [name, *(value(own[key], ".2f") for key in ("nearest_within_10deg", "peak_within_10deg", "entropy"))]
        for name, own in objects.items()
        if not own["can_be_told"]
    ]
    return table(("object", "nearest neighbour within 10°", "peak within 10°", "entropy [nats]"), rows)


def lookalikes(results: KeptResults) -> str:
    """How unsure single views leave which of two look-alikes it is."""
    rows = [
        [own["pair"], value(own["behind"], ".2f"), value(own["front"], ".2f")]
        for own in results.at(f"{STUDY}:ambiguity")
    ]
    return table(("pair", "from behind [nats]", "in front"), rows)


SECTIONS = (
    Section(
        STUDY,
        "Photographs on turntables",
        "COIL-100's objects as far as they were at hand, a picture every 5°, under a frozen SqueezeNet. Five objects a"
        " draw, two of them look-alikes; a head with dropout knows views within 80° of the front; class models from"
        " views every 20°; tracks of twelve other views, half of them in random rooms, partly hidden at times."
        " Places lie 1 m from the object. Latent models learn from pictures every 10°; an object can be told when the"
        " nearest training picture lies within 10° for 95 % of those held out. *Widened*: by the factor that leaving a"
        " third of the trained objects out tells. NEES is 1 when consistent; an even likelihood over the azimuth has an"
        " entropy of 5.19 nats.",
        (
            *(
                (
                    f"Classification, places {words}",
                    MethodsTable(
                        study=STUDY,
                        columns=CLASSIFICATION,
                        rows={f"classification/{name}/{method}": text for method, text in METHODS.items()},
                    ),
                )
                for name, words in UNCERTAINTIES.items()
            ),
            ("Which of two look-alikes one view leaves open", lookalikes),
            (
                "Latent models, held-out pictures",
                MethodsTable(
                    study=STUDY,
                    columns=LATENT,
                    rows={f"latent/{name}": text for name, text in FORMULATIONS.items()},
                ),
            ),
            ("Objects whose azimuth nothing tells (MAP)", untold),
        ),
    ),
)
