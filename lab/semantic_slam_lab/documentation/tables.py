"""A camera that flies over tables, in all six of its pose."""

from semantic_slam_lab.documentation.kept_results import KeptResults
from semantic_slam_lab.documentation.markdown import table, value
from semantic_slam_lab.documentation.section import Section

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


def flights(results: KeptResults) -> str:
    """A row for each kind of flight."""
    rows = [
        (name, *(value(row[key], style) for key, (_, style) in COLUMNS.items()))
        for name, row in results.results[STUDY]["flights"].items()
    ]
    return table(("flight", *(title for title, _ in COLUMNS.values())), rows)


SECTIONS = (
    Section(
        STUDY,
        "Tables from a flying camera",
        "Simulated: ten rooms of things of four kinds on four tables, around which a camera with depth is carried twice"
        " (80 keyframes); odometry in all six errs by 2 % of every motion, roll and pitch follow gravity, the detector"
        " confuses one word in ten, misses one thing in ten and makes up a box in every tenth frame. No map; the"
        " configuration is `config/spatial.yaml`. Found are things that were detected twice; a room is all right where"
        " all of them and nothing else is said to exist. NEES are means over one value per room, of 6 and 3 degrees of"
        " freedom. Errors are root mean squares over positions.",
        (("Flights", flights),),
    ),
)
