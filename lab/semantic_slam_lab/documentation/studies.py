"""What the page of results says of each study: a sentence, its tables, and where the work behind it is described."""

from collections.abc import Callable
from dataclasses import dataclass

from semantic_slam_lab.documentation.kept_results import KeptResults
from semantic_slam_lab.documentation.markdown import table, value
from semantic_slam_lab.documentation.methods_table import Column, MethodsTable

TableOf = Callable[[KeptResults], str]


@dataclass(frozen=True)
class Section:
    """One study on the page of results."""

    study: str
    title: str
    text: str
    tables: tuple[tuple[str, TableOf], ...] = ()  # caption, table


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


ROOMS = MethodsTable(
    study="aliased_scenes",
    first="mean over ten rooms",
    columns=(
        Column("associations right", "association_right", ".1%"),
        Column("settled at keyframe", "keyframe_disambiguated", ".1f"),
        Column("ATE", "ate_m", ".2f m"),
        Column("dead reckoning, true start", "dead_reckoning_true_start_ate_m", ".2f m"),
        Column("from the prior mean", "dead_reckoning_ate_m", ".1f m"),
        Column("least P(true class)", "min_true_class_probability", ".3f"),
    ),
    rows={
        "methods/ours": "default",
        "methods/gp_correlated": "`gp_correlated`",
        "methods/no_semantics": "`da_bsp`: geometry alone",
    },
)


def each_room(results: KeptResults) -> str:
    """Rooms one by one."""
    columns = ("room", "settled: default", "`gp_correlated`", "`da_bsp`", "ATE: default", "`gp_correlated`", "`da_bsp`")
    rows = [
        [
            str(room["scene"]),
            *(value(room[name].get("keyframe_disambiguated"), ".0f") for name in _KINDS),
            *(value(room[name]["ate_m"], ".2f m") for name in _KINDS),
        ]
        for room in results.at("aliased_scenes:scenes")
    ]
    return table(columns, rows)


_KINDS = ("ours", "gp_correlated", "no_semantics")

OBJECTS = (
    Column("GOSPA", "gospa_m", ".3f m"),
    Column("runs without a ghost", "runs_without_ghost", ".0%"),
    Column("runs with every object", "runs_complete", ".0%"),
    Column("class NLL", "nll", ".2g"),
    Column("class ECE", "ece", ".3f"),
    Column("association F1", "association_f1", ".3f"),
    Column("NEES of the pose", "nees", ".1f"),
    Column("ATE", "ate_m", ".2f m"),
)
MAPPERS = {
    "ours": "open world",
    "max_mixture": "one hypothesis (max-mixture)",
    "no_semantics": "DA-BSP (geometry alone)",
    "hybrid_smoother": "GTSAM's HybridSmoother",
    "nearest_neighbour": "nearest neighbour + arg max",
}


def _mapped(line: str) -> MethodsTable:
    rows = {f"lines/{line}/{name}": words for name, words in MAPPERS.items()}
    return MethodsTable(study="aliased_room", columns=OBJECTS, rows=rows, first="method")


DRIVE = (
    Column("F1", "association_f1", ".3f"),
    Column("F1, doubtful pairs as one", "association_f1_merged", ".3f"),
    Column("landmarks", "n_landmarks", ".0f"),
    Column("RMS to known association", "rms_to_known_association_m", ".2f m"),
    Column("real time", "real_time_factor", ".0f ×"),
    Column("ms per keyframe", "ms_per_keyframe_p50", ".2f"),
    Column("95 %", "ms_per_keyframe_p95", ".1f"),
    Column("peak RSS", "peak_rss_mb", ".0f MB"),
)
DRIVERS = {
    "ours": "open world, 10 hypotheses",
    "joint_assignment": "joint assignment, one hypothesis",
    "nearest_neighbour": "nearest neighbour",
}
VICTORIA_PARK = MethodsTable(
    study="victoria_park",
    columns=DRIVE,
    rows={f"methods/{name}": words for name, words in DRIVERS.items()},
    first="method",
)


def harder_drives(results: KeptResults) -> str:
    """Victoria Park with detections left out, blind stretches, other odometry noise: F1 of every method."""
    found = results.results["victoria_park"]
    rows = [_range_row("10 % of the detections dropped", found["dropped_10"])]
    for key, words in (("dropped_40", "40 % dropped"), ("blind_100m", "100 m blind in every 300 m")):
        rows.append([words, *(_f1(found[key].get(name)) for name in DRIVERS)])
    for factor, row in found["odometry_factors"].items():
        rows.append([f"odometry covariance × {factor}", _f1(row), "–", "–"])
    return table(("F1, doubtful pairs as one", *DRIVERS.values()), rows)


def _f1(row: dict[str, float] | None) -> str:
    return "–" if row is None else f"{row['association_f1_merged']:.3f}"


def _range_row(words: str, reruns: dict[str, dict[str, float]]) -> list[str]:
    """Least and greatest over the reruns ``number/method`` of each method."""
    cells = [words]
    for name in DRIVERS:
        own = sorted(row["association_f1_merged"] for key, row in reruns.items() if key.endswith(f"/{name}"))
        cells.append(f"{own[0]:.3f} … {own[-1]:.3f} ({len(own)} reruns)" if own else "–")
    return cells


STATISTICS = MethodsTable(
    study="ch4_statistics",
    first="mean over 50 tracks",
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
    first="all keyframes of 50 tracks",
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
    first="20 repetitions",
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


SPACES = {
    "formulations/map": "MAP, turntable crops",
    "formulations/energy": "energy, turntable crops",
    "summary": "the shipped model, in rooms",
}


def _formulations(study: str, *columns: Column) -> MethodsTable:
    return MethodsTable(study=study, columns=columns, rows=SPACES, first="formulation")


def _latent_slam(told: str) -> MethodsTable:
    words = {"latent": "descriptors", "classes": "a classifier of the same goods", "no_semantics": "geometry alone"}
    return MethodsTable(
        study="latent_slam",
        first="mean over ten rooms",
        columns=(
            Column("associations right", "association_right", ".1%"),
            Column("settled at keyframe", "keyframe_disambiguated", ".1f"),
            Column("rooms that never settle", "rooms_never_disambiguated", ".0f"),
            Column("ATE", "ate_m", ".2f m"),
            Column("dead reckoning", "dead_reckoning_ate_m", ".1f m"),
        ),
        rows={f"maps/{told}/{name}": text for name, text in words.items()},
    )


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
        "aliased_scenes",
        "Ten rooms, robot lost",
        "Ten rendered rooms of eight pieces of furniture, several identical, almost on a grid; an uncertain map, classes"
        " unknown, the start off by metres with a standard deviation of 10 m. *Settled at k*: from keyframe k on the true"
        " association history has probability 0.99 or more.",
        (("", ROOMS), ("Room by room", each_room)),
    ),
    Section(
        "aliased_room",
        "No map: births, misses, false alarms",
        "30 drives through ten rooms with identical furniture, no map, 10 % false alarms and 10 % misses added. All methods"
        " share the front end of births and existence.",
        (("Odometry as configured", _mapped("default")), ("Three times its noise", _mapped("slippery"))),
    ),
    Section(
        "victoria_park",
        "Victoria Park, landmark numbers hidden",
        "A real drive of 3331 keyframes among trunks. Landmark numbers serve the scores alone. Odometry's bias is estimated"
        " with the poses, and evidence chooses how much larger than the file's its covariance is; methods of one hypothesis"
        " cannot choose and are given what ours chose.",
        (("", VICTORIA_PARK), ("Harder drives", harder_drives)),
    ),
    Section(
        "ch4_statistics",
        "Chapter 4: fifty tracks among look-alikes",
        "Fig. 4.5: a robot lost by 10 m among six objects of one class, ten keyframes, viewpoint dependency α. Averages over"
        " runs and keyframes.",
        (("", STATISTICS), ("Are its probabilities honest?", CONFIDENCE)),
    ),
    Section("ch4_example", "Chapter 4: the example", "Figs. 4.3 and 4.4 with other noise each time.", (("", EXAMPLE),)),
    Section(
        "replay_scaling",
        "Objects and backends",
        "A lost robot among 10, 100 and 1000 look-alike objects, one and two backend processes.",
        (("", replays),),
    ),
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
    Section(
        "ch5_likelihood",
        "Chapter 5: what a view tells",
        "Views halfway between the trained directions: does the likelihood peak where the view was taken, and which instance"
        " is it? NEES of the inferred azimuth is 1 when its spread is honest.",
        (
            (
                "",
                _formulations(
                    "ch5_likelihood",
                    Column("peak within 10°", "peak_within_10deg", ".1%"),
                    Column("ascent from 30° ends within 5°", "peak_within_5deg_local", ".1%"),
                    Column("instance from one view", "instance_identification", ".1%"),
                    Column("from five", "instance_identification_5_views", ".1%"),
                    Column("new instances: peak", "new_instances_peak_within_10deg", ".0%"),
                    Column("NEES", "nees"),
                    Column("untempered", "nees_untempered"),
                    Column("new instances: NEES", "new_instances_nees"),
                ),
            ),
        ),
    ),
    Section(
        "ch5_sensitivity",
        "Chapter 5: ascent from a wrong start",
        "Sec. 5.D: how often ascent of the likelihood from a start that is off improves it.",
        (
            (
                "",
                _formulations(
                    "ch5_sensitivity",
                    Column("start", "start_deg", ".0f °"),
                    Column("improved", "improved_fraction", ".0%"),
                    Column("median error after", "median_error_deg", ".1f °"),
                    Column("improved from up to 90°", "improved_fraction_up_to_90deg", ".0%"),
                ),
            ),
        ),
    ),
    Section(
        "ch5_localization",
        "Chapter 5: tracks around an object",
        "Odometry and the learned factor alone, descriptor unknown; error against dead reckoning's.",
        (
            (
                "",
                _formulations(
                    "ch5_localization",
                    Column("median error / dead reckoning's", "median_error_vs_dead_reckoning"),
                    Column("tracks improved", "share_of_tracks_improved", ".0%"),
                    Column("descriptor known", "descriptor_known_median_error_vs_dead_reckoning"),
                    Column("new objects", "new_objects_median_error_vs_dead_reckoning"),
                    Column("tracks", "n_tracks", ".0f"),
                ),
            ),
        ),
    ),
    Section(
        "ch5_latent_space",
        "Chapter 5: the descriptor space",
        "Unseen views encoded; no class label was used in training.",
        (
            (
                "",
                _formulations(
                    "ch5_latent_space",
                    Column("nearest view shows the same instance", "nearest_view_same_instance", ".0%"),
                    Column("the same class", "nearest_view_same_class", ".0%"),
                    Column("silhouette", "silhouette_by_instance"),
                    Column("dimensions", "dimensions", ".0f"),
                ),
            ),
        ),
    ),
    Section(
        "ch5_grounding",
        "Chapter 5: two tagged instances per class",
        "Sec. 5.6.A: untagged instances classified after tagging two of each class; beside it a supervised classifier.",
        (
            (
                "",
                _formulations(
                    "ch5_grounding",
                    Column("Gaussians, one view", "gaussian_1_view", ".0%"),
                    Column("three views", "gaussian_3_views", ".0%"),
                    Column("nearest, one view", "nearest_1_view", ".0%"),
                    Column("three views", "nearest_3_views", ".0%"),
                    Column("supervised on the same tags, one view", "supervised_1_view", ".0%"),
                    Column("three views", "supervised_3_views", ".0%"),
                ),
            ),
        ),
    ),
    Section(
        "latent_slam",
        "Chapter 5: descriptors in SLAM",
        "Ten rooms with two different instances of each of four classes, robot lost by 10 m, association unknown.",
        (
            ("A map of poses alone", _latent_slam("poses")),
            ("A map that names what stands there", _latent_slam("names")),
        ),
    ),
    Section(
        "bench",
        "Benchmarks",
        "`make bench`: ratios against peers, each measured within one run on one core. A ratio is peer's time over ours where"
        " a peer is named, ours over the floor where a floor is, an exponent where growth is measured.",
        (("", benchmarks),),
    ),
)
