"""What the drives have to show, as far as what was run can tell."""

from collections.abc import Callable, Sequence

from semantic_slam_lab.studies.real_drives.drives import DLR, KITTI, MRCLAM
from semantic_slam_lab.studies.real_drives.methods import ABLATIONS, BASELINES, BATCH, GIVEN, OURS, WITH_ROBOTS
from semantic_slam_lab.studies.real_drives.rows import Drives, Rows, failures
from semantic_slam_lab.studies.result import Claim, required

DENSITY_ABLATIONS = ("without_correlation", "without_outliers", "without_estimated_noise")

Test = Callable[[float], bool]
Comparison = Callable[[float, float], bool]
Pair = tuple[float | None, float | None]


def claims_of(drives: Drives) -> list[Claim]:
    """Claims about the drives of a result; one that needs a method that was not run is left out.

    No claim holds where a run that it is about failed; it names the drive.
    """
    return [*_mrclam(drives), *_given(drives), *_dlr(drives), *_kitti(drives)]


def _mrclam(drives: Drives) -> list[Claim]:
    ours, given = Rows.of(drives, MRCLAM, OURS), Rows.of(drives, MRCLAM, GIVEN)
    if not ours:
        return []
    claims = [
        _each("Pairwise F1 at least 0.85 of the ceiling", ours, "f1_of_ceiling", ".2f", lambda v: v >= 0.85),
        _each("Cluster F1 at least 0.98", ours, "association_f1_clusters", ".3f", lambda v: v >= 0.98),
        _each("15 ± 2 objects", ours, "num_objects", ".0f", lambda v: abs(v - 15) <= 2),
        _each(
            "Of pairs stated with P ≥ 0.9, at least 85 % are one", ours, "pair_right_at_90", ".2f", lambda v: v >= 0.85
        ),
        _each("ECE of the probabilities of pairs at most 0.05", ours, "pair_ece", ".3f", lambda v: v <= 0.05),
        _each("NEES of the pose between 0.5 and 6", ours, "nees_mean", ".1f", lambda v: 0.5 <= v <= 6.0),
        _each("The 95 % region holds the truth in 85 to 100 %", ours, "region95_held", ".2f", lambda v: v >= 0.85),
        _each("Median radius at most 0.3 m", ours, "region95_median_radius_m", ".2f m", lambda v: v <= 0.3),
    ]
    if given.drives == ours.drives:
        text = "ATE at most 1.25 times that with numbers given, or 0.15 m"
        claims.insert(0, _errors(text, ours, given, lambda own, other: own <= max(1.25 * other, 0.15)))
    for method in (*BASELINES, *ABLATIONS):
        claims += _against(ours, Rows.of(drives, MRCLAM, method))
    with_robots = Rows.of(drives, MRCLAM, WITH_ROBOTS)
    if with_robots:
        text = "At least 80 % of the other robots called moving"
        claims.append(_each(text, with_robots, "robots_called_moving", ".2f", lambda v: v >= 0.8))
    return claims


def _against(ours: Rows, theirs: Rows) -> list[Claim]:
    """Means over the robots against a baseline's, or the density of the truth against an ablation's."""
    if theirs.drives != ours.drives:
        return []
    method = theirs.method
    if method in BASELINES:
        ate, clusters = (
            f"Mean ATE below that of {method}",
            f"Mean cluster F1 not below that of {method}, or at least 0.99",
        )
        return [
            _means(ate, ours, theirs, "ate_aligned_m", ".2f m", lambda own, other: own < other),
            _means(clusters, ours, theirs, "association_f1_clusters", ".3f", lambda own, f1: own >= min(f1, 0.99)),
        ]
    if method not in DENSITY_ABLATIONS:
        return []
    text = f"Mean log density of the true pose above that {method.replace('_', ' ')}"
    return [_means(text, ours, theirs, "log_density", ".2f", lambda own, other: own > other)]


def _given(drives: Drives) -> list[Claim]:
    given, batch = Rows.of(drives, MRCLAM, GIVEN), Rows.of(drives, MRCLAM, BATCH)
    if not given:
        return []
    claims = [_each("Numbers given: NEES between 0.5 and 5", given, "nees_mean", ".1f", lambda v: 0.5 <= v <= 5.0)]
    if batch.drives == given.drives:
        text = "Numbers given: ATE at most 1.25 times the robust batch's, and 0.18 m"
        claims.append(_errors(text, given, batch, lambda own, other: own <= min(1.25 * other, 0.18)))
    return claims


def _dlr(drives: Drives) -> list[Claim]:
    ours = Rows.of(drives, DLR, OURS)
    if not ours:
        return []
    return [
        _each("DLR: pairwise F1 at least 0.97", ours, "association_f1", ".3f", lambda v: v >= 0.97),
        _each("DLR: 576 ± 30 objects", ours, "num_objects", ".0f", lambda v: abs(v - 576) <= 30),
        _each("DLR: at most 147 s of CPU", ours, "cpu_s", ".0f s", lambda v: v <= 147.0),
    ]


def _kitti(drives: Drives) -> list[Claim]:
    ours = Rows.of(drives, KITTI, OURS)
    if not ours:
        return []
    ghosts = zip(ours.values("ghosts"), ours.values("num_objects"), strict=True)
    shares = [None if some is None or every is None else some / max(every, 1) for some, every in ghosts]
    ates = zip(ours.values("ate_aligned_m"), ours.values("dead_reckoning_ate_aligned_m"), strict=True)
    return [
        _each("KITTI: at least 95 % of the parked cars found", ours, "parked_recall", ".2f", lambda v: v >= 0.95),
        _all("KITTI: at most 5 % ghosts", shares, ".0%", failures(ours), lambda v: v <= 0.05),
        _each("KITTI: at least 80 % of the movers called moving", ours, "moving_recall", ".2f", lambda v: v >= 0.8),
        _pairs(
            "KITTI: ATE at most half of dead reckoning's",
            list(ates),
            ".1f m",
            failures(ours),
            lambda own, dead: own <= 0.5 * dead,
        ),
    ]


def _each(text: str, rows: Rows, key: str, style: str, test: Test) -> Claim:
    """A claim about a metric on every drive of ``rows``."""
    return _all(text, rows.values(key), style, failures(rows), test)


def _errors(text: str, ours: Rows, theirs: Rows, test: Comparison) -> Claim:
    """A claim about the ATE on every drive beside that of another method."""
    ates = zip(ours.values("ate_aligned_m"), theirs.values("ate_aligned_m"), strict=True)
    return _pairs(text, list(ates), ".2f m", failures(ours, theirs), test)


def _means(text: str, ours: Rows, theirs: Rows, key: str, style: str, test: Comparison) -> Claim:
    """A claim about the mean of a metric over all drives beside that of another method."""
    own, other, (form, _, unit) = ours.mean(key), theirs.mean(key), style.partition(" ")
    measured = f"{_told(own, form)} and {_told(other, form)} {unit}".strip()
    return required(text, measured + failures(ours, theirs), _compare(own, other, test))


def _all(text: str, values: Sequence[float | None], style: str, failed: str, test: Test) -> Claim:
    """A claim about all of some values; one that is not known does not hold."""
    form, _, unit = style.partition(" ")
    measured = f"{', '.join(_told(value, form) for value in values)} {unit}".strip()
    return required(text, measured + failed, all(value is not None and test(value) for value in values))


def _pairs(text: str, pairs: Sequence[Pair], style: str, failed: str, test: Comparison) -> Claim:
    """A claim about all of some comparisons; one with a value that is not known does not hold."""
    form, _, unit = style.partition(" ")
    measured = ", ".join(f"{_told(own, form)} ({_told(other, form)}) {unit}" for own, other in pairs)
    return required(text, measured + failed, all(_compare(own, other, test) for own, other in pairs))


def _compare(own: float | None, other: float | None, test: Comparison) -> bool:
    return own is not None and other is not None and test(own, other)


def _told(value: float | None, form: str) -> str:
    return "unknown" if value is None else format(value, form)
