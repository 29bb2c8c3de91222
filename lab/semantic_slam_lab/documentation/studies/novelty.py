"""Novelty: what is called unknown, against false alarms."""

from collections.abc import Callable

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "novelty"
SETTINGS = (
    ("imagenet", "alone", "ImageNet network, objects alone"),
    ("imagenet", "rooms", "ImageNet network, objects in random rooms"),
    ("shipped", "alone", "Shipped network, objects alone"),
    ("shipped", "rooms", "Shipped network, objects in random rooms"),
)
GROUPS = (("unknown", "unknown objects"), ("noise", "noise"), ("blocks", "coloured blocks"))
METHODS = (("ours", "ours"), ("nearest", "nearest fitted view"))


def curve(network: str, setting: str) -> Callable[[KeptResults], str]:
    """A table of shares by false alarms, and of the false alarms that stated ones give."""

    def made(results: KeptResults) -> str:
        result = results.results[STUDY]
        methods, rates = result["networks"][network][setting], result["config"]["rates"]
        rows = [
            (f"{text}: {pictures}", *_shares(methods[method]["curve"]["realised"][group]))
            for group, pictures in GROUPS
            for method, text in METHODS
        ]
        rows += [
            (f"{text}: false alarms where these are stated", *_shares(methods[method]["curve"]["stated"]["known"]))
            for method, text in METHODS
        ]
        return table(("called unknown, at false alarms of", *(value(rate, ".0%") for rate in rates)), rows)

    return made


def _shares(shares: list[float]) -> tuple[str, ...]:
    return tuple(value(share, ".1%") for share in shares)


SECTIONS = (
    Section(
        STUDY,
        "Novelty: what no class model knows",
        "`in_coverage` by the features of the trunk (`perception.novelty_false_alarms`), as a curve. COIL-100: in each"
        " draw twelve objects are known by photographs every 20°, all others are unknown; *noise*: independent"
        " pixels; *coloured blocks*: rectangles on one colour. False alarms are new views of the known objects, half"
        " way between the fitted ones: that share of them, to one view of each draw, is called unknown in a column. The"
        " last two rows have the limit of a user, who knows the views left out of the fit alone. *ours*: density of"
        " known objects' views against that of things that are made up; *nearest fitted view*: cosine of the features."
        " The ImageNet network is SqueezeNet. Random rooms are those of the training: other scales, light, inexact"
        " boxes, and a part hidden at times. The page of the study has the curves as a picture.",
        tuple((text, curve(network, setting)) for network, setting, text in SETTINGS),
    ),
)
