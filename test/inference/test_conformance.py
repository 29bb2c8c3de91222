"""Every fixture with an exact answer, through the engine that the nodes run.

``SEMANTIC_SLAM_FIXTURES`` names another folder of fixtures.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from worlds.exact.chapter3_fixtures import check_classification
from worlds.exact.exact_fixtures import Outcome, run
from worlds.exact.spatial_fixtures import spatial_deviations

from semantic_slam.configuration import PruningConfiguration
from semantic_slam.evaluation.mixture import heaviest_position_error, position_determinant, weighted_position_error
from semantic_slam.geometry.moments import matched_moments
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.inference.entropy import association_entropy, component_entropy
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.frames import camera_in_object, object_in_body
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.pruning import prune
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel

FOLDER = Path(os.environ.get("SEMANTIC_SLAM_FIXTURES", Path(__file__).parents[1] / "fixtures"))
FILES = sorted(FOLDER.glob("*.json"))


@pytest.mark.conformance
def test_conformance_fixtures_exist() -> None:
    assert FILES, f"no *.json in {FOLDER}"


@pytest.mark.conformance
@pytest.mark.parametrize("path", FILES, ids=[path.stem for path in FILES])
def test_fixture(path: Path) -> None:
    data = json.loads(path.read_text(encoding="utf-8"))
    assert data["schema"] in CHECKS, f"{path.name}: unknown schema {data['schema']!r}"
    CHECKS[data["schema"]](data)


def check_linear_gaussian(data: dict) -> None:
    deviations = _deviations(data, run(data), run(data, semantics=False))
    tolerance = data["tol"]["abs"]
    assert {name: value for name, value in deviations.items() if not value <= tolerance} == {}


def check_planar(data: dict) -> None:
    tolerance = data["tol"]
    deviations = _deviations(data, run(data), run(data, semantics=False))
    limits = {name: tolerance.get(_tolerance_of(name), np.inf) for name in deviations}
    exceeded = {name: (value, limits[name]) for name, value in deviations.items() if not value <= limits[name]}
    assert exceeded == {}


def _tolerance_of(name: str) -> str:
    return {"log_evidence": "log_evidence_abs", "xk_mean": "mean_abs", "xk_mean_no_semantic": "mean_abs"}.get(
        name, "weight_abs"
    )


def _deviations(data: dict, outcome: Outcome, geometric: Outcome) -> dict[str, float]:
    expected = data["expected"]
    linear = "Sv" in data["input"] and np.ndim(data["input"]["Sv"]) == 2
    hypotheses = [(_key(row["beta"]), tuple(row["C"]), row) for row in expected["hypotheses"]]
    found = [outcome.hypotheses.get((beta, assignment), (0.0, -np.inf)) for beta, assignment, _ in hypotheses]
    relevant = [i for i, (_, _, row) in enumerate(hypotheses) if linear or row["weight"] > 1e-3]
    deviations = {
        "weight": max(abs(pair[0] - row["weight"]) for pair, (_, _, row) in zip(found, hypotheses, strict=True)),
        "log_evidence": max(abs(found[i][1] - hypotheses[i][2]["log_evidence"]) for i in relevant),
        "P_beta": _association_deviation(outcome, expected["P_beta"]),
        "P_beta_no_semantic": _association_deviation(geometric, expected["P_beta_no_semantic"]),
        "P_class": float(np.abs(outcome.belief.class_probabilities - np.array(expected["P_class"])).max()),
        "xk_mean": _mean_deviation(outcome, expected["xk_mean"]),
    }
    if "xk_mean_no_semantic" in expected:
        deviations["xk_mean_no_semantic"] = _mean_deviation(geometric, expected["xk_mean_no_semantic"])
    if "xk_cov" in expected:
        deviations["xk_cov"] = float(np.abs(_moments(outcome)[1][:2, :2] - np.array(expected["xk_cov"])).max())
        deviations |= _best_deviations(outcome, expected["best"])
    return deviations


def _best_deviations(outcome: Outcome, best: dict) -> dict[str, float]:
    """The best hypothesis with its classes given; engine components carry the classes of unobserved objects lazily."""
    rows = [i for i, beta in enumerate(outcome.betas) if beta == _key(best["beta"])]
    classes = outcome.belief.hypothesis_class_probabilities
    row = next(i for i in rows if all(classes[i, n, c] > 0.0 for n, c in enumerate(best["C"])))
    belief = outcome.belief
    return {
        "best_mean": float(np.abs(belief.poses[row, :2] - np.array(best["xk_mean"])).max()),
        "best_cov": float(np.abs(belief.pose_covariances[row, :2, :2] - np.array(best["xk_cov"])).max()),
    }


def _association_deviation(outcome: Outcome, rows: list[dict]) -> float:
    return max(abs(outcome.associations.get(_key(row["beta"]), 0.0) - row["p"]) for row in rows)


def _moments(outcome: Outcome) -> tuple[np.ndarray, np.ndarray]:
    belief = outcome.belief
    return matched_moments(np.exp(belief.log_weights), belief.poses, belief.pose_covariances)


def _mean_deviation(outcome: Outcome, expected: list[float]) -> float:
    mean = planar_from_pose_vector(_moments(outcome)[0])
    difference = mean[: len(expected)] - np.array(expected)
    if len(expected) == 3:
        difference[2] = wrap_angle(difference[2])
    return float(np.abs(difference).max())


def _key(beta: list[list[int]]) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(frame) for frame in beta)


def check_deterministic(data: dict) -> None:
    tolerance = data["tol"]["abs"]
    for row in data["rows"]:
        _check_models(row, data, tolerance)
    _check_weights(data["weights"], tolerance)
    _check_metrics(data["metrics"], tolerance)


def _check_models(row: dict, data: dict, tolerance: float) -> None:
    model = ParametricModel(row["alpha"], data["sem"]["K"])
    observation = PlanarObservation(model, PlanarVisibility())
    noise = np.diag([data["Sigma_v"]["range"], data["Sigma_v"]["bearing"]])
    detection = PlanarDetection(
        range_m=row["z_geo"][0],
        bearing_rad=row["z_geo"][1],
        covariance=noise,
        sensor=np.zeros(2),
        feature=np.array(row["z_sem"]),
        feature_covariance=np.zeros((2, 2)),
    )
    seen = observation.collect([detection])
    x, o, classes = np.array([row["x"]]), np.array([row["o"]]), np.array([row["c"]])
    d, v = object_in_body(x, o)[0], camera_in_object(x, o, np.zeros(2))[0]
    azimuth = np.arctan2(v[1], v[0])
    prediction = model.predict(classes, Viewpoints(np.array([azimuth]), np.zeros(1), np.ones(1)))
    np.testing.assert_allclose([np.hypot(*d), np.arctan2(d[1], d[0])], row["range_bearing"], rtol=0, atol=tolerance)
    assert abs(azimuth - row["theta"]) <= tolerance
    np.testing.assert_allclose(prediction.mean[0], row["h"], rtol=0, atol=tolerance)
    np.testing.assert_allclose(prediction.covariance[0], data["sem"]["Sigma_c"], rtol=0, atol=tolerance)
    for name, part in (
        ("loglik_geo", observation.geometry(seen, x, o)),
        ("loglik_sem", observation.semantics(seen, x, o, classes)),
    ):
        density = part.log_normaliser[0] - 0.5 * (part.residual[0] ** 2).sum()
        assert abs(density - row[name]) <= tolerance * max(1.0, abs(row[name]))


def _check_weights(data: dict, tolerance: float) -> None:
    log_psi = np.array(data["input"]["log_psi"])
    log_weights = (np.log(data["input"]["parents"])[:, None] + log_psi).ravel()
    pruned = prune(
        log_weights,
        np.arange(log_weights.size, dtype=np.uint64),
        np.zeros(0),
        PruningConfiguration(ratio=data["prune"], max_hypotheses=log_weights.size),
    )
    weights = np.zeros(log_weights.size)
    weights[pruned.kept] = np.exp(pruned.log_weights)
    before = np.array(data["normalised_global"])
    kept = np.array(data["kept"], dtype=bool)
    np.testing.assert_allclose(weights.reshape(log_psi.shape), data["pruned"], rtol=0, atol=tolerance)
    assert abs(pruned.discarded - before[~kept].sum()) <= tolerance


def _check_metrics(data: dict, tolerance: float) -> None:
    given = data["input"]
    weights, means, covariances = np.array(given["w"]), np.array(given["mean"]), np.array(given["cov"])
    reference = np.array(given["x_gt"])
    measured = {
        "H_components": component_entropy(weights),
        "H_beta": association_entropy(weights, given["beta_id"]),
        "det_position_of_max": position_determinant(weights, covariances),
        "err_max": heaviest_position_error(weights, means, reference),
        "err_weighted": weighted_position_error(weights, means, reference),
    }
    for name, value in measured.items():
        assert abs(value - data[name]) <= tolerance, name


def check_spatial(data: dict) -> None:
    tolerance, found = data["tol"], spatial_deviations(data)
    limits = {"weight": tolerance["weight_abs"], "log_evidence": tolerance["log_evidence_abs"]}
    exceeded = {name: value for name, value in found.items() if not value <= limits.get(name, tolerance["mean_sigmas"])}
    assert exceeded == {}


CHECKS = {
    "exact-ch3/1": check_classification,
    "exact-ch4-lg/1": check_linear_gaussian,
    "exact-ch4-se2/1": check_planar,
    "exact-ch4-se3/1": check_spatial,
    "exact-ch4-se3-bodies/1": check_spatial,
    "exact-ch4-det/1": check_deterministic,
}
