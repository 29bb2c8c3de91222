"""Chapter 5: descriptors instead of classes."""

from semantic_slam_lab.documentation.writing.methods_table import Column, MethodsTable
from semantic_slam_lab.documentation.writing.section import Section

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
        first="mean over the rooms",
        columns=(
            Column("associations right", "association_right", ".1%"),
            Column("settled at keyframe", "keyframe_disambiguated", ".1f"),
            Column("rooms that never settle", "rooms_never_disambiguated", ".0f"),
            Column("ATE", "ate_m", ".2f m"),
            Column("dead reckoning", "dead_reckoning_ate_m", ".1f m"),
        ),
        rows={f"maps/{told}/{name}": text for name, text in words.items()},
    )


SECTIONS = (
    Section(
        "ch5_likelihood",
        "Chapter 5: what a view tells",
        "Views halfway between the trained directions: does the likelihood peak where the view was taken, and which"
        " instance is it? NEES of the inferred azimuth is 1 when its spread is honest.",
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
        "Sec. 5.D: how often ascent of the likelihood from a start that is off improves it. The thesis also finds"
        " ascent over the camera's orientation extremely unstable (Fig. 5.6c). That is not tried here: a tight crop"
        " carries no orientation, and the factor has no derivative by it.",
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
        "Ten rooms (a quick run: one) with two different instances of each of four classes, robot lost by 10 m,"
        " association unknown.",
        (
            ("A map of poses alone", _latent_slam("poses")),
            ("A map that names what stands there", _latent_slam("names")),
        ),
    ),
)
