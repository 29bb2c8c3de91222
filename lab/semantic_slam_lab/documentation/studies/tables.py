"""A camera that flies over tables, in all six of its pose."""

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.section import Section

STUDY = "tables"
COLUMNS = {
    "all_right": ("rooms all right", ""),
    "found": ("found", ""),
    "seen": ("of", ""),
    "false": ("false", ""),
    "associated": ("associated right", ".2%"),
    "pose_nees": ("NEES of pose (6)", ".2f"),
    "object_nees": ("NEES of object (3)", ".2f"),
    "odometry_m": ("odometry", ".3f m"),
    "error_m": ("estimate", ".3f m"),
    "cpu_s": ("CPU of a flight", ".1f s"),
    "slowest_s": ("slowest keyframe", ".2f s"),
}


STARTS = {
    "right": ("settled right", ""),
    "rooms": ("of", ""),
    "off_m": ("off before", ".1f m"),
    "error_m": ("error after, median", ".3f m"),
    "most_wrong": ("most weight of one that is elsewhere", ".3f"),
    "cpu_s": ("CPU of 15 keyframes", ".1f s"),
    "slowest_s": ("slowest keyframe", ".2f s"),
}


def flights(results: KeptResults) -> str:
    """A row for each kind of flight."""
    return _rows(results, "flights", "flight", COLUMNS)


def starts(results: KeptResults) -> str:
    """A row for each kind of map."""
    return _rows(results, "starts", "on the map", STARTS)


def _rows(results: KeptResults, part: str, title: str, columns: dict[str, tuple[str, str]]) -> str:
    rows = [
        (name, *(value(row[key], style) for key, (_, style) in columns.items()))
        for name, row in results.results[STUDY][part].items()
    ]
    return table((title, *(own for own, _ in columns.values())), rows)


SECTIONS = (
    Section(
        STUDY,
        "Tables from a flying camera",
        "Simulated: ten rooms of things of four kinds on four tables, around which a camera with depth is carried twice"
        " (80 keyframes); odometry in all six errs by 2 % of every motion, roll and pitch follow gravity, the detector"
        " confuses one word in ten, misses one thing in ten and makes up a box in every tenth frame. No map; the"
        " configuration is `config/spatial.yaml`. Found are things that were detected twice; a room is all right where"
        " all of them and nothing else is said to exist. NEES are means over one value per room, of 6 and 3 degrees of"
        " freedom. Errors are root mean squares over positions. Lost: ten more rooms, on a map (each place"
        " known to 2 cm), the first pose off with a standard deviation of 3 m along x and y and any yaw; right is a"
        " hypothesis within 0.3 m.",
        (("Flights", flights), ("Lost on a map", starts)),
    ),
)
