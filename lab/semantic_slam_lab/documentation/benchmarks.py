"""The benchmark: ratios against peers."""

from semantic_slam_lab.documentation.kept_results import KeptResults
from semantic_slam_lab.documentation.markdown import table, value
from semantic_slam_lab.documentation.section import Section

THOUSAND = 1000.0
"""From which on three digits would need an exponent."""


def benchmarks(results: KeptResults) -> str:
    """Every ratio of the benchmark, with what it means."""
    columns = ("benchmark", "ours", "peer", "ratio", "how")
    rows = [
        [
            f"`{row['name']}`",
            _measured(row["ours"], row["unit"]),
            _measured(row["peer"], row["unit"]),
            f"**{_measured(row['ratio'])}**",
            f"{row['how']} (n = {row['n']})",
        ]
        for row in results.at("bench:results")
    ]
    return table(columns, rows)


def _measured(number: float | None, unit: str = "1") -> str:
    """Three digits and the unit; ``1`` is none."""
    style = ",.0f" if number is not None and abs(number) >= THOUSAND else ".3g"
    return value(number, style if unit == "1" else f"{style} {unit}")


SECTIONS = (
    Section(
        "bench",
        "Benchmarks",
        "`make bench`: ratios against peers, each measured within one run on one core. A ratio is peer's time over"
        " ours where a peer is named, ours over the floor where a floor is, an exponent where growth is measured.",
        (("", benchmarks),),
    ),
)
