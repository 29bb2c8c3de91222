"""Several objects that a map lacks: alike before they are seen, and so no history twice."""

from collections.abc import Sequence
from functools import cache
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association import closed_keyframe
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

FAR = 300.0  # metres ahead, where range and bearing are as good as linear in the place of a point
MAPPED, SIGMA_MAPPED = np.array([FAR + 3.0, 1.0]), 0.3
CLUTTER, REACH, SIGMA = 0.05, 4.0, 0.4
FRAMES = [
    np.array([[FAR + 2.0, 0.0], [FAR + 2.5, 1.0]]),
    np.array([[FAR + 2.2, -0.3], [FAR + 3.0, -1.5]]),
    np.array([[FAR + 2.6, 0.7]]),
]
SEEN_AGAIN = np.array([[FAR + 3.0, 1.0], [FAR + 2.0, -1.5]])
ALL_KEPT = {"gate": np.inf, "max_candidates": 100_000, "max_associations": 0, "method": "laplace"}
Assigned = tuple[tuple[int, ...], ...]


def _beliefs(
    num_unmapped: int,
    probability: float,
    distinct: bool = True,
    frames: Sequence[Array] = FRAMES,
    most: int = 100_000,
) -> list[HybridBelief]:
    """Of a robot whose pose is known, with all histories kept, up to ``most``."""
    configuration = Configuration.of(
        observation="points",
        semantic_model={"kind": "none"},
        distinct_assignment=distinct,
        closed_world={
            "clutter_per_frame": CLUTTER,
            "unmapped_objects": num_unmapped,
            "unmapped_probability": probability,
        },
        open_world={"max_range_m": REACH},
        pruning={"ratio": 1e30, "max_hypotheses": most},
        weights=ALL_KEPT,
    )
    known = MapPrior((ObjectPrior.planar(0, *MAPPED, sigma_m=SIGMA_MAPPED, sigma_rad=0.1),))
    engine = Engine(configuration, known, initial_pose=np.zeros(3), initial_covariance=1e-12 * np.eye(3))
    still = (1e-6, 1e-6, 1e-6)
    seen = [[Detection.at(*at, covariance=np.eye(2) * SIGMA**2) for at in points] for points in frames]
    return [engine.process(Keyframe.planar(k, detections=own, motion_sigmas=still)) for k, own in enumerate(seen)]


def _log_weights(num_unmapped: int, probability: float, distinct: bool) -> dict[Assigned, float]:
    """Log of the joint density of all points with each history, in which every placeholder has its own label."""
    region = Configuration().open_world
    area = 0.5 * region.field_of_view_rad * (REACH**2 - region.min_range_m**2)
    options = range(-1, 1 + num_unmapped)
    of_frames = [
        [
            own
            for own in product(options, repeat=len(points))
            if not distinct or len({n for n in own if n >= 0}) == sum(n >= 0 for n in own)
        ]
        for points in FRAMES
    ]
    found = {}
    for history in product(*of_frames):
        labels = np.concatenate(history)
        log_weight = float((labels == -1).sum() * np.log(CLUTTER / area))
        for number in set(labels.tolist()) - {-1}:
            log_weight += _log_density(tuple(np.flatnonzero(labels == number)), number > 0) + (
                np.log(probability) if number else 0.0
            )
        found[history] = log_weight
    return found


@cache
def _log_density(rows: tuple[int, ...], is_unmapped: bool) -> float:
    """Log joint density of some of the points, all of one object, whose place is integrated out."""
    sigma = REACH / 2.0 if is_unmapped else SIGMA_MAPPED
    spread = sigma**2 * np.ones((len(rows),) * 2) + SIGMA**2 * np.eye(len(rows))
    points = np.concatenate(FRAMES)[list(rows)]
    return float(sum(multivariate_normal(np.full(len(rows), MAPPED[i]), spread).logpdf(points[:, i]) for i in (0, 1)))


def _unlabelled(history: Assigned) -> Assigned:
    """The history with placeholders numbered in the order of their first detections."""
    order: dict[int, int] = {}
    return tuple(tuple(order.setdefault(n, len(order) + 1) if n > 0 else n for n in own) for own in history)


@pytest.mark.long
@pytest.mark.parametrize(
    ("num_unmapped", "probability", "distinct"), [(1, 0.2, True), (3, 0.2, True), (2, 1.0, True), (2, 0.2, False)]
)
def test_the_evidence_is_that_of_all_histories_with_labelled_placeholders(
    num_unmapped: int, probability: float, distinct: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Written out, as far as range and bearing are linear; and exactly that of an engine with all labels."""
    beliefs = _beliefs(num_unmapped, probability, distinct)
    labelled = _log_weights(num_unmapped, probability, distinct)
    by_history: dict[Assigned, float] = {}
    for history, log_weight in labelled.items():
        own = _unlabelled(history)
        by_history[own] = np.logaddexp(by_history.get(own, -np.inf), log_weight)
    # The engine's densities are per metre and radian: of a point at range r they are r times those per square metre.
    log_metric = np.log(np.linalg.norm(np.concatenate(FRAMES), axis=1)).sum()
    total = float(np.logaddexp.reduce(list(labelled.values())))
    log_evidence = [belief.log_evidence for belief in beliefs]
    assert sum(log_evidence) == pytest.approx(total + log_metric, abs=0.01)
    assert len(beliefs[-1].hypothesis_ids) == len(by_history)
    weights = np.sort(np.exp(np.array(list(by_history.values())) - total))
    np.testing.assert_allclose(np.sort(np.exp(beliefs[-1].log_weights)), weights, rtol=0.05, atol=1e-12)
    monkeypatch.setattr(closed_keyframe, "Placeholders", SimpleNamespace(of=lambda *_: None))
    monkeypatch.setattr(closed_keyframe, "log_num_labellings", lambda *_: 0.0)
    every = _beliefs(num_unmapped, probability, distinct)
    assert len(every[-1].hypothesis_ids) == len(labelled)
    np.testing.assert_allclose(log_evidence, [belief.log_evidence for belief in every], atol=1e-9)
    # As many exist as before; only their names differ.
    assert beliefs[-1].existence.sum() == pytest.approx(every[-1].existence.sum(), abs=1e-9)


def test_what_is_seen_again_and_again_has_one_name() -> None:
    """Of three objects that the map may lack, one is surely seen, and the others stay about as likely as before."""
    one, three = (_beliefs(num_unmapped, 0.1, frames=[SEEN_AGAIN] * 4, most=60)[-1] for num_unmapped in (1, 3))
    assert one.existence[1] > 0.99 and three.existence[1] > 0.99
    assert (three.existence[2:] < 0.3).all()
    np.testing.assert_allclose(three.object_poses[1, :2], one.object_poses[1, :2], atol=0.2)
