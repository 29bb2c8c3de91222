"""Studies on photographs: a kitchen that is mapped, a cabinet that is told from other things."""

from collections.abc import Callable

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.methods_table import Column
from semantic_slam_lab.documentation.writing.section import Section

KITCHEN, CABINET = "real_kitchen", "real_cabinet"
KITCHEN_COLUMNS = (
    Column("ghosts", "ghosts", ".0f"),
    Column("objects of all classes", "num_objects", ".0f"),
    Column("ECE of classes", "class_ece", ".2f"),
    Column("over all keyframes", "class_ece_online", ".2f"),
    Column("ATE", "ate_aligned_m", ".3f m"),
    Column("odometry's", "odometry_ate_aligned_m", ".3f m"),
    Column("NEES", "nees_mean", ".1f"),
    Column("keyframes", "num_keyframes", ".0f"),
)
CABINET_COLUMNS = (
    Column("right at the end", "correct_rate_final", ".0%"),
    Column("at all views", "correct_rate_overall", ".0%"),
    Column("loss", "nll", ".2f"),
    Column("ECE", "ece", ".2f"),
    Column("log MGR, 95 %", "log_mgr_final_p95", ".1f"),
    Column("settled", "settled_share", ".0%"),
)
SUBJECTS = (("right", "cabinet"), ("biased", "cabinet"), ("right", "all"), ("biased", "all"))


def kitchen(results: KeptResults) -> str:
    """Every way of mapping the kitchen."""
    methods = results.results[KITCHEN]["methods"]
    rows = []
    for name, row in methods.items():
        errors = [error for error in row["position_error_m"].values() if error is not None]
        counts = ", ".join(f"{count} {label}" for label, count in row["counts"].items())
        largest = f"{max(errors):.2f} m of {len(errors)}" if errors else "–"
        rows.append((name.replace("_", " "), counts, largest, *(value(row[c.key], c.style) for c in KITCHEN_COLUMNS)))
    return table(("method", "found", "largest error", *(column.heading for column in KITCHEN_COLUMNS)), rows)


def cabinet(setting: str, subject: str) -> Callable[[KeptResults], str]:
    """A table of every method in one setting."""

    def made(results: KeptResults) -> str:
        methods = results.results[CABINET]["settings"][setting][subject]
        rows = [
            (name.replace("_", " "), *(value(row[column.key], column.style) for column in CABINET_COLUMNS))
            for name, row in methods.items()
        ]
        return table(("method", *(column.heading for column in CABINET_COLUMNS)), rows)

    return made


SECTIONS = (
    Section(
        KITCHEN,
        "A kitchen in photographs",
        "RedKitchen of 7-Scenes, every fourth of 1000 frames of a hand-held camera: boxes and scores of NanoDet,"
        " depth, visual odometry (ORB and PnP); no map. Three identical chairs and two mugs stand there; where is"
        " the median of their boxes with depth under the given poses, to which the path is aligned. *ours*:"
        " `config/detector.yaml` with `perception.labels: [chair, cup]` and a keyframe every 0.1 m or 0.1 rad;"
        " *all labels*: whatever is detected; the others: other keyframes. The given poses level the camera, as an"
        " inertial sensor would. *ghost*: a chair or cup with existence above one half that is none of the five."
        " Of the keyframes' spacing three were tried.",
        (("", kitchen),),
    ),
    Section(
        CABINET,
        "A cabinet in photographs",
        "TUM's fr3_cabinet, 58 photographs around one cabinet, and chairs, cups, a monitor and a table of"
        " RedKitchen. Scores: SqueezeNet with dropout, ImageNet's classes in five groups, chosen by their names."
        " Each object's views are divided into five stretches; models over the direction of view are fitted"
        " without the stretch that they are tried on. Then every camera is taken to be elsewhere by one offset a"
        " track, 0.3 m along each axis, twenty times. *Model Based* takes mean scores and places as certain;"
        " *Simple Bayes* takes scores for likelihoods.",
        tuple(
            (
                f"{'The cabinet' if subject == 'cabinet' else 'All objects'}, camera"
                f" {'where it is' if setting == 'right' else 'taken to be elsewhere'}",
                cabinet(setting, subject),
            )
            for setting, subject in SUBJECTS
        ),
    ),
)
