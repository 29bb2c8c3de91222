"""The benchmark: ratios against peers."""

from semantic_slam_lab.documentation.kept_results import KeptResults
from semantic_slam_lab.documentation.markdown import table, value
from semantic_slam_lab.documentation.section import Section


def benchmarks(results: KeptResults) -> str:
    """Every ratio of the benchmark, with what it means."""
    columns = ("benchmark", "ours", "peer", "ratio", "how")
    rows = [
        [
            f"`{row['name']}`",
            f"{_short(row['ours'])} {row['unit']}",
            f"{_short(row['peer'])} {row['unit']}",
            f"**{_short(row['ratio'])}**",
            f"{row['how']} (n = {row['n']})",
        ]
        for row in results.at("bench:results")
    ]
    return table(columns, rows)


def _short(number: float | None) -> str:
    return value(number, ".3g")


SECTIONS = (
    Section(
        "bench",
        "Benchmarks",
        "`make bench`: ratios against peers, each measured within one run on one core. A ratio is peer's time over"
        " ours where a peer is named, ours over the floor where a floor is, an exponent where growth is measured.",
        (("", benchmarks),),
    ),
)
