"""The metrics of a report, each with its meaning."""

from dataclasses import dataclass

MEANINGS = {
    "association_right": "share of detections that the final hypothesis gives their true object",
    "association_f1": "pairs of detections of one object, under the final hypothesis against the truth",
    "association_f1_annotated": "pairs among the detections that have a true id: what nobody annotated is left out",
    "association_precision": "share of claimed pairs that are true",
    "association_recall": "share of true pairs that are claimed",
    "detections_without_true_id": "detections of false alarms, or of things that nobody annotated",
    "objects_without_true_id": "objects that exist at the end, to most of whose detections no true id is known",
    "keyframe_disambiguated": "keyframe from which P(true association) stays at 0.99 or more",
    "min_true_class_probability": "least probability that any object's true class has at the end",
    "class_nll": "mean of −ln P(true class) over the objects at the end, nats",
    "class_ece": "calibration error of the top class over the objects at the end, 15 bins",
    "class_nll_online": "mean of −ln P(true class) over all objects and keyframes, nats",
    "class_ece_online": "calibration error of the top class over all objects and keyframes, 15 bins",
    "ate_m": "RMS position error in map of the final hypothesis's path, unaligned, m",
    "ate_aligned_m": "RMS position error of the final hypothesis's path after the best rigid alignment, m",
    "ate_online_m": "RMS position error in map of the best hypothesis of each keyframe at its time, unaligned, m",
    "dead_reckoning_ate_m": "odometry alone from the mean of the robot's prior, m",
    "dead_reckoning_true_start_ate_m": "odometry alone from the true start, m",
    "nees_mean": "squared pose error over its stated covariance; 3 on average in the plane when honest",
}


@dataclass(frozen=True)
class MetricRow:
    """One line of the table."""

    name: str
    value: str
    meaning: str


def metric_rows(metrics: dict[str, float | int | None]) -> list[MetricRow]:
    """Known metrics in the order of their meanings, the others behind them."""
    names = [*(name for name in MEANINGS if name in metrics), *(name for name in metrics if name not in MEANINGS)]
    return [MetricRow(name, _text(metrics[name]), MEANINGS.get(name, "")) for name in names]


def _text(value: float | int | None) -> str:
    if value is None:
        return "never"
    if value != value:
        return "not known"
    return str(value) if isinstance(value, int) else f"{value:.4f}"
