"""What the drives have to show, as far as what was run can tell."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from semantic_slam_lab.studies.real_drives.drives import DLR, KITTI, MRCLAM
from semantic_slam_lab.studies.real_drives.methods import ABLATIONS, BASELINES, BATCH, GIVEN, OURS, WITH_ROBOTS
from semantic_slam_lab.studies.result import Claim, required

DENSITY_ABLATIONS = ("without_correlation", "without_outliers", "without_estimated_noise")

Row = Mapping[str, Any]
Drives = Mapping[str, Mapping[str, Mapping[str, Row]]]


def claims_of(drives: Drives) -> list[Claim]:
    """Claims about the drives of a result; one that needs a method that was not run is left out."""
    return [*_mrclam(drives), *_given(drives), *_dlr(drives), *_kitti(drives)]


def _rows(drives: Drives, kind: str, method: str) -> dict[str, Row]:
    """Drive -> metrics of a method that was run on it to its end."""
    own = {name: drive["methods"] for name, drive in drives.items() if name.startswith(kind)}
    return {
        name: methods[method]
        for name, methods in own.items()
        if methods.get(method, {"fault": ""}).get("fault") is None
    }


def _mrclam(drives: Drives) -> list[Claim]:
    ours, given = _rows(drives, MRCLAM, OURS), _rows(drives, MRCLAM, GIVEN)
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
    if given.keys() == ours.keys():
        ates = [(row["ate_aligned_m"], given[name]["ate_aligned_m"]) for name, row in ours.items()]
        text = "ATE at most 1.25 times that with numbers given, or 0.15 m"
        measured = ", ".join(f"{own:.2f} ({told:.2f}) m" for own, told in ates)
        claims.insert(0, required(text, measured, all(own <= max(1.25 * told, 0.15) for own, told in ates)))
    for method in (*BASELINES, *ABLATIONS):
        claims += _against(ours, _rows(drives, MRCLAM, method), method)
    with_robots = _rows(drives, MRCLAM, WITH_ROBOTS)
    if with_robots:
        text = "At least 80 % of the other robots called moving"
        claims.append(_each(text, with_robots, "robots_called_moving", ".2f", lambda v: v >= 0.8))
    return claims


def _against(ours: dict[str, Row], theirs: dict[str, Row], method: str) -> list[Claim]:
    """Means over the robots against a baseline's, or the density of the truth against an ablation's."""
    if theirs.keys() != ours.keys():
        return []
    if method in BASELINES:
        own, other = _mean(ours, "ate_aligned_m"), _mean(theirs, "ate_aligned_m")
        f1, other_f1 = _mean(ours, "association_f1_clusters"), _mean(theirs, "association_f1_clusters")
        return [
            required(f"Mean ATE below that of {method}", f"{own:.2f} and {other:.2f} m", own < other),
            required(
                f"Mean cluster F1 not below that of {method}, or at least 0.99",
                f"{f1:.3f} and {other_f1:.3f}",
                f1 >= min(other_f1, 0.99),
            ),
        ]
    if method not in DENSITY_ABLATIONS:
        return []
    own, other = _mean(ours, "log_density"), _mean(theirs, "log_density")
    return [
        required(
            f"Mean log density of the true pose above that {_words(method)}", f"{own:.2f} and {other:.2f}", own > other
        )
    ]


def _words(method: str) -> str:
    return method.replace("_", " ")


def _given(drives: Drives) -> list[Claim]:
    given, batch = _rows(drives, MRCLAM, GIVEN), _rows(drives, MRCLAM, BATCH)
    if not given:
        return []
    claims = [_each("Numbers given: NEES between 0.5 and 5", given, "nees_mean", ".1f", lambda v: 0.5 <= v <= 5.0)]
    if batch.keys() == given.keys():
        ates = [(row["ate_aligned_m"], batch[name]["ate_aligned_m"]) for name, row in given.items()]
        text = "Numbers given: ATE at most 1.25 times the robust batch's, and 0.18 m"
        measured = ", ".join(f"{own:.2f} ({other:.2f}) m" for own, other in ates)
        claims.append(required(text, measured, all(own <= min(1.25 * other, 0.18) for own, other in ates)))
    return claims


def _dlr(drives: Drives) -> list[Claim]:
    ours = _rows(drives, DLR, OURS)
    if not ours:
        return []
    return [
        _each("DLR: pairwise F1 at least 0.97", ours, "association_f1", ".3f", lambda v: v >= 0.97),
        _each("DLR: 576 ± 30 objects", ours, "num_objects", ".0f", lambda v: abs(v - 576) <= 30),
        _each("DLR: at most 147 s of CPU", ours, "cpu_s", ".0f s", lambda v: v <= 147.0),
    ]


def _kitti(drives: Drives) -> list[Claim]:
    ours = _rows(drives, KITTI, OURS)
    if not ours:
        return []
    shares = [row["ghosts"] / max(row["num_objects"], 1) for row in ours.values()]
    ates = [(row["ate_aligned_m"], row["dead_reckoning_ate_aligned_m"]) for row in ours.values()]
    return [
        _each("KITTI: at least 95 % of the parked cars found", ours, "parked_recall", ".2f", lambda v: v >= 0.95),
        required("KITTI: at most 5 % ghosts", ", ".join(f"{share:.0%}" for share in shares), max(shares) <= 0.05),
        _each("KITTI: at least 80 % of the movers called moving", ours, "moving_recall", ".2f", lambda v: v >= 0.8),
        required(
            "KITTI: ATE at most half of dead reckoning's",
            ", ".join(f"{own:.1f} ({dead:.1f}) m" for own, dead in ates),
            all(own <= 0.5 * dead for own, dead in ates),
        ),
    ]


def _each(text: str, rows: dict[str, Row], key: str, style: str, test: Callable[[float], bool]) -> Claim:
    """A claim about every drive of ``rows``; a metric that is not known does not hold."""
    values: Sequence[float | None] = [row.get(key) for row in rows.values()]
    form, _, unit = style.partition(" ")
    measured = ", ".join("unknown" if value is None else format(value, form) for value in values)
    return required(text, f"{measured} {unit}".strip(), all(value is not None and test(value) for value in values))


def _mean(rows: dict[str, Row], key: str) -> float:
    return float(np.mean([row[key] for row in rows.values()]))
