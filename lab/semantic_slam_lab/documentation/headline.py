"""README's one table: what semantics bring in three kinds of world, beside what stands in for it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value


@dataclass(frozen=True, kw_only=True)
class Row:
    """One metric of one study: addresses of our value, of geometry alone's, and of other baselines' by their names."""

    words: str
    ours: str
    other: str
    style: str
    baselines: Mapping[str, str] = field(default_factory=dict)

    def cells(self, results: KeptResults) -> tuple[str, str, str]:
        """Words, our value, and what stands beside it. Raises InputError for an address without a result."""
        beside = [value(results.at(self.other), self.style)]
        beside += [f"{name}: {value(results.at(own), self.style)}" for name, own in self.baselines.items()]
        return self.words, f"**{value(results.at(self.ours), self.style)}**", "; ".join(beside)


ROWS = (
    Row(
        words="[Ten rendered rooms](docs/results.md#ten-rooms-robot-lost), robot lost by 10 m among look-alikes:"
        " associations settled at keyframe",
        ours="aliased_scenes:methods/ours/keyframe_disambiguated",
        other="aliased_scenes:methods/no_semantics/keyframe_disambiguated",
        style=".1f",
    ),
    Row(
        words="error of the path in map",
        ours="aliased_scenes:methods/ours/ate_m",
        other="aliased_scenes:methods/no_semantics/ate_m",
        style=".2f m",
    ),
    Row(
        words="[Fifty tracks](docs/results.md#chapter-4-fifty-tracks-among-look-alikes) of ten keyframes among six"
        " objects of one class: P(true association history) at the end",
        ours="ch4_statistics:methods/ours/p_true_association_final",
        other="ch4_statistics:methods/no_semantics/p_true_association_final",
        style=".2f",
    ),
    Row(
        words="error of the weighted position, all keyframes",
        ours="ch4_statistics:methods/ours/error_weighted_m",
        other="ch4_statistics:methods/no_semantics/error_weighted_m",
        style=".1f m",
    ),
    Row(
        words="[No map](docs/results.md#no-map-births-misses-false-alarms), 10 % false alarms, 10 % misses, 30 drives:"
        " error of the mapped objects, missing and false ones included (GOSPA)",
        ours="aliased_room:methods/ours/gospa_m",
        other="aliased_room:methods/no_semantics/gospa_m",
        style=".2f m",
        baselines={
            "one hypothesis": "aliased_room:methods/max_mixture/gospa_m",
            "GTSAM's HybridSmoother": "aliased_room:methods/hybrid_smoother/gospa_m",
            "nearest neighbour": "aliased_room:methods/nearest_neighbour/gospa_m",
        },
    ),
)


def headline(results: KeptResults) -> str:
    """Rows of which the study is kept."""
    rows = [row.cells(results) for row in ROWS if results.has(row.ours.partition(":")[0])]
    return table(("", "with semantics", "geometry alone (DA-BSP)"), rows)
