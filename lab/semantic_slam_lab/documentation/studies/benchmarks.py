"""The benchmark: ratios against peers."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section

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
        "Ours and a peer in turn within one run, on one core. The ratio is the peer's time over ours for"
        " `…_vs_literal…`, `…_vs_sampled`, `…_vs_shared_samples` and `…_vs_loop`; ours over the other's for"
        " `…_vs_one_pass`, `…_floor`, `…_vs_planar…`, `…_time…`, `…_all_runs…`, `…_builtin`, total variations and the"
        " like; throughput for `two_backends_vs_one`; the exponent itself for `…_growth…`.",
        (("", benchmarks),),
        "make bench",
    ),
)
