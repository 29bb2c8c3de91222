"""Rooms and drives: the lost robot, the world without a map, Victoria Park."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.methods_table import Column, MethodsTable
from semantic_slam_lab.documentation.writing.section import Section

ROOMS = MethodsTable(
    study="aliased_scenes",
    first="mean over the rooms",
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
    "nearest_neighbour": "nearest neighbour",
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
        cells.append(f"{own[0]:.3f} … {own[-1]:.3f} (reruns: {len(own)})" if own else "–")
    return cells


SECTIONS = (
    Section(
        "aliased_scenes",
        "Ten rooms, robot lost",
        "Ten rendered rooms (a quick run: one) of eight pieces of furniture, several identical, almost on a grid; an"
        " uncertain map, classes unknown, the start off by metres with a standard deviation of 10 m. *Settled at k*:"
        " from keyframe k on the true association history has probability 0.99 or more; a room in which it never has"
        " counts in the mean as the keyframe after its last.",
        (("", ROOMS), ("Room by room", each_room)),
    ),
    Section(
        "aliased_room",
        "No map: births, misses, false alarms",
        "30 drives through ten rooms (fewer in a quick run) with identical furniture, no map, 10 % false alarms and"
        " 10 % misses added. All methods share the front end of births and existence; those without class models"
        " get the product of the network's scores as their classes.",
        (("Odometry as configured", _mapped("default")), ("Three times its noise", _mapped("slippery"))),
    ),
    Section(
        "victoria_park",
        "Victoria Park, landmark numbers hidden",
        "A real drive among trunks, 3331 keyframes (a quick run takes the first 400). Landmark numbers serve the scores"
        " alone. Odometry's bias is estimated with the poses, and evidence chooses how much larger than the file's its"
        " covariance is; methods of one hypothesis cannot choose and are given what ours chose.",
        (("", VICTORIA_PARK), ("Harder drives", harder_drives)),
    ),
)
