"""Chapter 4: the lost robot among look-alikes, and what objects and backends cost."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.methods_table import Column, MethodsTable
from semantic_slam_lab.documentation.writing.section import Section

STATISTICS = MethodsTable(
    study="ch4_statistics",
    first="mean over the tracks",
    columns=(
        Column("entropy of associations", "association_entropy", ".2f nats"),
        Column("det Σ", "det_position_covariance", ".4f m⁴"),
        Column("weighted error", "error_weighted_m", ".2f m"),
        Column("P(truth) at the end", "p_true_association_final", ".2f"),
        Column("worst run", "p_true_association_least", ".2f"),
        Column("hypotheses", "num_hypotheses", ".1f"),
        Column("discarded mass", "discarded_mass_final", ".4f"),
        Column("runs that lost the truth", "truth_lost", ".0f"),
    ),
    rows={
        **{f"alphas/{alpha}": f"α = {alpha}" for alpha in ("0.05", "0.25", "0.5", "0.75", "1.0")},
        "methods/no_semantics": "without semantics (DA-BSP)",
        "methods/sampled": "α = 0.25, the thesis's 1000 prior samples",
    },
)
CONFIDENCE = MethodsTable(
    study="ch4_statistics",
    first="all keyframes of all tracks",
    columns=(
        Column("mean probability of the likeliest association history", "confidence", ".3f"),
        Column("share in which it is the true one", "likeliest_is_true", ".3f"),
    ),
    rows={
        "methods/ours": "α = 0.25",
        "methods/no_semantics": "without semantics (DA-BSP)",
        "methods/sampled": "the thesis's 1000 prior samples",
    },
)
EXAMPLE = MethodsTable(
    study="ch4_example",
    first="over the repetitions",
    columns=(
        Column("settled at keyframe, median", "median_keyframe_disambiguated", ".0f"),
        Column("one component from, median", "median_keyframe_single_component", ".0f"),
        Column("P(truth) at the end", "p_true_association_final", ".4f"),
        Column("runs lost", "runs_lost", ".0f"),
    ),
    rows={"methods/ours": "α = 0.25", "methods/no_semantics": "without semantics (DA-BSP)"},
)


def replays(results: KeptResults) -> str:
    """Time of a keyframe by objects and backends."""
    columns = ("objects", "backends", "keyframes", "ms per keyframe", "95 %", "speed-up", "hypotheses", "right", "RSS")
    rows = [
        [
            str(row["objects"]),
            str(row["backends"]),
            str(row["keyframes"]),
            value(row.get("ms_per_keyframe_p50"), ".0f"),
            value(row.get("ms_per_keyframe_p95"), ".0f"),
            value(row.get("speedup"), ".2f"),
            value(row.get("hypotheses_mean"), ".1f"),
            value(row.get("association_right"), ".2f"),
            value(row.get("peak_rss_mb"), ".0f MB"),
        ]
        for row in results.at("replay_scaling:replays")
    ]
    return table(columns, rows)


SECTIONS = (
    Section(
        "ch4_statistics",
        "Chapter 4: fifty tracks among look-alikes",
        "Fig. 4.5: a robot lost by 10 m among six objects of one class, ten keyframes, viewpoint dependency α."
        " Averages over runs and keyframes.",
        (("", STATISTICS), ("Are its probabilities honest?", CONFIDENCE)),
    ),
    Section("ch4_example", "Chapter 4: the example", "Figs. 4.3 and 4.4 with other noise each time.", (("", EXAMPLE),)),
    Section(
        "replay_scaling",
        "Objects and backends",
        "A lost robot among 10, 100 and 1000 look-alike objects, one and two backend processes.",
        (("", replays),),
    ),
)
