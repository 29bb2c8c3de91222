"""An exact answer in SE(3) among points in R^3, by importance sampling: python -m semantic_slam_lab.exact.spatial FILE.

Every association history is sampled by itself, from an even mixture of the Gaussian at its mode and of one 1.4 times as
wide, so that no tail of the posterior is without draws. A second seed and samples from the prior tell how far it is
off.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from semantic_slam_lab.exact.spatial_problem import Array, SpatialProblem, States

DRAWS, CHUNK, SEEDS = 1 << 17, 1 << 14, (1, 2)
"""Draws for each history and seed: with 36 histories 4.7 million each."""
WIDER = 1.4
SEEN = ((0, 1), (2, 0))
"""Which point each detection is truly of."""


def problem(seed: int = 13) -> SpatialProblem:
    """Three points within reach of each other's uncertainty, seen in pairs on two keyframes of a robot that tumbles."""
    random = np.random.default_rng(seed)
    step = [0.4, 0.05, 0.1, *Rotation.from_rotvec([0.1, -0.15, 0.2]).as_quat().tolist()]
    given: dict[str, Any] = {
        "x0": [0.1, -0.1, 0.2, *Rotation.from_rotvec([0.5, -0.3, 0.9]).as_quat().tolist()],
        "Sp": [0.01, 0.01, 0.02, 0.08, 0.08, 0.06],
        "objects": [[1.2, 1.9, 0.6], [1.5, 1.4, 1.1], [1.0, 2.7, 0.2]],
        "So": [0.05, 0.04, 0.03],
        "u": [step, step],
        "Sw": [0.001, 0.001, 0.001, 0.0025, 0.0025, 0.0025],
        "Sv": [0.04, 0.0225, 0.0225],
        "exclusive": True,
        "Z": [[{"range": 1.0, "ray": [1.0, 0.0, 0.0]}] * len(frame) for frame in SEEN],
    }
    drawn = SpatialProblem(given)
    truth = drawn.states(random.standard_normal((1, drawn.size)))
    by_range, by_ray, _ = np.sqrt(given["Sv"])
    given["Z"] = [
        [seen_along(turn.inv().apply(truth.points[0, n] - place)[0], by_range, by_ray, random) for n in frame]
        for turn, place, frame in zip(truth.turns, truth.places, SEEN, strict=True)
    ]
    return drawn


def seen_along(body: Array, by_range: float, by_ray: float, random: np.random.Generator) -> dict[str, Any]:
    """A detection of a point (3,) in the body frame, with errors of both."""
    ray = body / np.linalg.norm(body)
    aside = np.cross(ray, by_ray * random.standard_normal(3))
    turned = Rotation.from_rotvec(np.cross(ray, aside)).apply(ray)
    return {"range": float(np.linalg.norm(body) + by_range * random.standard_normal()), "ray": turned.tolist()}


@dataclass(frozen=True)
class Sampled:
    """What samples say of one history."""

    log_evidence: float
    relative_error: float
    effective: float
    mean: Array  # (M,) of moments() under its posterior


def sampled(given: SpatialProblem, history: Any, seed: int) -> Sampled:
    """By importance sampling about the mode."""
    mode, root = _mode(given, history)
    random, size = np.random.default_rng(seed), given.size
    logs, features = [], []
    for _ in range(DRAWS // CHUNK):
        normal = random.standard_normal((CHUNK, size))
        scale = np.where(np.arange(CHUNK) % 2 == 0, 1.0, WIDER)[:, None]
        y = mode + scale * normal @ root.T
        states = given.states(y)
        log_prior = -0.5 * (y**2).sum(axis=1)
        logs.append(given.log_density(states, history) + log_prior - _log_proposal(scale * normal, root))
        features.append(moments(states))
    log_weights = np.concatenate(logs)
    top = float(log_weights.max())
    weights = np.exp(log_weights - top)
    mean, spread = float(weights.mean()), float(weights.std())
    return Sampled(
        log_evidence=top + float(np.log(mean)),
        relative_error=spread / mean / float(np.sqrt(len(weights))),
        effective=float(weights.sum() ** 2 / (weights**2).sum()),
        mean=weights @ np.concatenate(features) / weights.sum(),
    )


def _mode(given: SpatialProblem, history: Any) -> tuple[Array, Array]:
    """Mode of the posterior of all deviations, and the root of its covariance there (Gauss-Newton)."""

    def residuals(y: Array) -> Array:
        return np.concatenate([y, given.residuals_of(given.states(y[None]), history)[0]])

    found = least_squares(residuals, np.zeros(given.size), method="lm")
    return found.x, np.linalg.cholesky(np.linalg.inv(found.jac.T @ found.jac))


def _log_proposal(deviation: Array, root: Array) -> Array:
    """(B,) of the mixture less (2 pi)^(size/2), at ``deviation`` (B, size) in the narrower part's own coordinates."""
    size, square = deviation.shape[1], (deviation**2).sum(axis=1)
    wide = -0.5 * square / WIDER**2 - size * np.log(WIDER)
    return np.asarray(np.logaddexp(-0.5 * square, wide) - np.log(2.0) - np.log(np.diagonal(root)).sum())


def moments(states: States) -> Array:
    """(B, M): of the newest place, its squares and products, of q q^T of the newest turn, and of all objects."""
    place, q = states.places[-1], states.turns[-1].as_quat()
    parts = [place, place[:, :, None] * place[:, None], q[:, :, None] * q[:, None], states.points]
    parts += [turn.as_quat()[:, :, None] * turn.as_quat()[:, None] for turn in states.object_turns]
    return np.concatenate([part.reshape(len(place), -1) for part in parts], axis=1)


def answer(given: SpatialProblem, seed: int) -> dict[str, Any]:
    """Weights of all explanations, log evidence, and moments of their mixture."""
    explanations = given.explanations()
    found = [sampled(given, own, seed + 1000 * row) for row, own in enumerate(explanations)]
    logs = np.array([own.log_evidence for own in found])
    total = float(np.logaddexp.reduce(logs))
    weights = np.exp(logs - total)
    mean = weights @ np.array([own.mean for own in found])
    place, points = mean[:3], mean[28 : 28 + 3 * given.num_points]
    turns = mean[28 + 3 * given.num_points :].reshape(-1, 4, 4)
    return {
        "hypotheses": [
            {**given.described(own), "log_evidence": float(log), "weight": float(weight)}
            for own, log, weight in zip(explanations, logs, weights, strict=True)
        ],
        "log_evidence": total,
        "xk_mean": [*place.tolist(), *_mean_turn(mean[12:28].reshape(4, 4))],
        "xk_place_cov": (mean[3:12].reshape(3, 3) - np.outer(place, place)).tolist(),
        "object_means": points.reshape(-1, 3).tolist(),
        **({"object_turns": list(map(_mean_turn, turns))} if len(turns) else {}),
        "relative_error": max(own.relative_error for own, weight in zip(found, weights, strict=True) if weight > 1e-3),
        "effective": min(own.effective for own, weight in zip(found, weights, strict=True) if weight > 1e-3),
    }


def _mean_turn(scatter: Array) -> list[float]:
    """The quaternion of unit length nearest to all of which ``scatter`` (4, 4) is the mean of q q^T."""
    turn = np.linalg.eigh(scatter)[1][:, -1]
    return [float(value) for value in turn * np.sign(turn[3])]


def prior_log_evidence(given: SpatialProblem, draws: int, seed: int) -> tuple[float, float]:
    """Log evidence of all explanations together by samples of the prior, and its relative error."""
    random, sums = np.random.default_rng(seed), []
    for _ in range(draws // CHUNK):
        states = given.states(random.standard_normal((CHUNK, given.size)))
        logs = [given.log_density(states, own) for own in given.explanations()]
        sums.append(np.exp(np.logaddexp.reduce(logs, axis=0)))
    values = np.concatenate(sums)
    return float(np.log(values.mean())), float(values.std() / values.mean() / np.sqrt(len(values)))


def write(given: SpatialProblem, path: Path, schema: str, name: str) -> None:
    """Write the fixture of a problem."""
    first, second = (answer(given, seed) for seed in SEEDS)
    pairs = zip(first["hypotheses"], second["hypotheses"], strict=True)
    log_prior, error = prior_log_evidence(given, 1 << 19, 3)
    checks = {
        "draws": DRAWS * len(given.explanations()),
        "weight_between_seeds": max(abs(one["weight"] - other["weight"]) for one, other in pairs),
        "place_between_seeds_m": float(np.abs(np.subtract(first["xk_mean"], second["xk_mean"])[:3]).max()),
        "relative_error": first.pop("relative_error"),
        "effective": first.pop("effective"),
        "prior_samples": {"log_evidence": log_prior, "relative_error": error},
    }
    fixture = {
        "schema": schema,
        "name": name,
        "input": given.given,
        "tol": {"weight_abs": 0.02, "mean_sigmas": 0.03, "log_evidence_abs": 0.03},
        "checks": checks,
        "expected": first,
    }
    path.write_text(json.dumps(fixture, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(checks, indent=1))


if __name__ == "__main__":
    write(problem(), Path(sys.argv[1]), "exact-ch4-se3/1", "SE3 and R3, N3 k2 n2")
