"""Frames with far more boxes than usual take bounded work, and what the bound cuts is in the belief."""

from dataclasses import replace
from typing import Any, Self

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe, MapPrior, ObjectPrior
from semantic_slam.inference.association import enumeration
from semantic_slam.inference.association.candidate_limit import LEAST_CANDIDATES, candidate_limit
from semantic_slam.inference.association.used_detections import SPARE
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.semantics.interface import ClassModels, NoSemantics, SemanticEvidence, SemanticInput

LOST = {"initial_pose": {"mean": [0.0, 0.0, 0.0], "sigma": [10.0, 10.0, 3.0]}, "semantic_model": {"kind": "none"}}


class Counting(NoSemantics):
    """No semantics; counts the associations of detections in all candidates of each keyframe."""

    def __init__(self) -> None:
        self.associations: list[int] = []

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        return cls()

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        self.associations.append(len(given.candidates.assignments) * len(given.used))
        return super().weigh(given)


def crowd(count: int) -> list[np.ndarray]:
    """(count, 2) things that stand close together before the robot, as it sees them in three keyframes."""
    random = np.random.default_rng(0)
    places = np.column_stack([random.uniform(1.0, 4.5, count), random.uniform(-0.9, 0.9, count)])
    return [places - [0.1 * k, 0.0] + random.normal(0.0, 0.05, (count, 2)) for k in range(1, 4)]


def counted(engine: Engine) -> tuple[Engine, Counting]:
    """The engine of the same run, with what it weighs counted."""
    semantics = Counting()
    problem = replace(engine.problem, semantics=semantics)
    return Engine.of_run(engine.run, InProcessPool(1, problem), problem), semantics


def seen(places: np.ndarray) -> list[Detection]:
    """Detections at (n, 2) places, the first of which have the best scores."""
    scores = np.linspace(0.9, 0.1, len(places)).tolist()
    return [Detection.at(x, y, score=score) for (x, y), score in zip(places.tolist(), scores, strict=True)]


@pytest.mark.parametrize("count", [1, 5, 20, 100, 1000])
def test_detections_in_all_candidates_are_bounded(count: int) -> None:
    weights = Configuration().weights
    most = candidate_limit(weights, count)
    assert LEAST_CANDIDATES <= most <= weights.max_candidates
    assert most == LEAST_CANDIDATES or most * count <= weights.max_associations
    assert candidate_limit(replace(weights, max_associations=0), count) == weights.max_candidates


def test_ordinary_frames_have_the_candidates_that_are_configured() -> None:
    weights = Configuration().weights
    assert candidate_limit(weights, 4) == weights.max_candidates


def test_a_crowd_in_an_open_world_is_mapped_with_what_is_left_out_stated() -> None:
    settings: dict[str, Any] = {"semantic_model": {"kind": "none"}, "weights": {"max_associations": 160}}
    engine, counting = counted(Engine(Configuration.of(association="open", **settings)))
    for k, places in enumerate(crowd(20)):
        belief = engine.process(Keyframe.planar(k, detections=seen(places), motion=(0.1, 0.0, 0.0)))
    parents = engine.problem.pruning.max_hypotheses
    assert max(counting.associations) <= LEAST_CANDIDATES * parents * 20
    assert belief.discarded_mass > 0.01 and belief.existence.sum() == pytest.approx(20.0, abs=6.0)


def test_a_lost_robot_associates_the_best_scored_boxes_alone() -> None:
    """Those that are left are clutter in every hypothesis."""
    random = np.random.default_rng(1)
    prior = MapPrior(
        tuple(ObjectPrior.planar(k, *random.uniform(-5.0, 5.0, 2), sigma_m=0.1, sigma_rad=0.1) for k in range(4))
    )
    engine = Engine(Configuration.of(**LOST, closed_world={"clutter_per_frame": 0.5}), prior)
    belief = engine.process(Keyframe.planar(0, detections=seen(crowd(60)[0])))
    used = 4 + SPARE
    assert (belief.associations[:, used:] < 0).all() and (belief.associations[:, :used] >= 0).any()


@pytest.mark.long
def test_parents_taken_a_few_at_a_time_have_the_candidates_of_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit, with what is left out."""
    prior = MapPrior(tuple(ObjectPrior.planar(k, 2.0 + k, 0.4 * k, sigma_m=0.1, sigma_rad=0.1) for k in range(4)))
    beliefs = []
    for most in (enumeration.MOST_BYTES, 1.0):
        monkeypatch.setattr(enumeration, "MOST_BYTES", most)
        engine = Engine(Configuration.of(**LOST, closed_world={"clutter_per_frame": 0.5}), prior)
        for k, places in enumerate(crowd(4)):
            belief = engine.process(Keyframe.planar(k, detections=seen(places), motion=(0.1, 0.0, 0.0)))
        beliefs.append(belief)
    assert len(beliefs[0].log_weights) > 1
    for name in ("log_weights", "poses", "discarded_mass"):
        np.testing.assert_array_equal(getattr(beliefs[0], name), getattr(beliefs[1], name))
