"""README's one table: what semantics bring in three kinds of world, beside what stands in for it."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value

Row = tuple[str, str, str, str]
"""Words, address of our value, address of the other's, style."""

ROWS: tuple[Row, ...] = (
    (
        "[Ten rendered rooms](docs/results.md#ten-rooms-robot-lost), robot lost by 10 m among look-alikes:"
        " associations settled at keyframe",
        "aliased_scenes:methods/ours/keyframe_disambiguated",
        "aliased_scenes:methods/no_semantics/keyframe_disambiguated",
        ".1f",
    ),
    (
        "error of the path in map",
        "aliased_scenes:methods/ours/ate_m",
        "aliased_scenes:methods/no_semantics/ate_m",
        ".2f m",
    ),
    (
        "[Fifty tracks](docs/results.md#chapter-4-fifty-tracks-among-look-alikes) of ten keyframes among six objects of"
        " one class: P(true association history) at the end",
        "ch4_statistics:methods/ours/p_true_association_final",
        "ch4_statistics:methods/no_semantics/p_true_association_final",
        ".2f",
    ),
    (
        "error of the weighted position, all keyframes",
        "ch4_statistics:methods/ours/error_weighted_m",
        "ch4_statistics:methods/no_semantics/error_weighted_m",
        ".1f m",
    ),
    (
        "[No map](docs/results.md#no-map-births-misses-false-alarms), 10 % false alarms, 10 % misses, 30 drives:"
        " calibration error of the class probabilities (ECE)",
        "aliased_room:methods/ours/ece",
        "aliased_room:methods/no_semantics/ece",
        ".3f",
    ),
)


def headline(results: KeptResults) -> str:
    """Rows of which both results are kept."""
    rows = [
        (words, f"**{value(results.at(ours), style)}**", value(results.at(other), style))
        for words, ours, other, style in ROWS
        if results.has(ours.partition(":")[0])
    ]
    return table(("", "with semantics", "geometry alone (DA-BSP)"), rows)
