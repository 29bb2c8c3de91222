"""What range and bearing rule out: a bound that holds, and beliefs that do not depend on it."""

from dataclasses import replace

import numpy as np
import pytest
from semantic_slam_lab.grid.run import keyframes_of, run_of
from semantic_slam_lab.grid.world import Noise, World, grid_world
from semantic_slam_lab.studies.replay_scaling.study import belief_difference

from semantic_slam.inference.association import closed_keyframe, map_gate
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem, PredictedBelief
from semantic_slam.inference.evidence.laplace import find_modes
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces

MODEL = PlanarObservation(None, PlanarVisibility())
LOST = Noise(robot=(0.5, 0.5, 0.01))


def detection(range_m: float, bearing_rad: float, sensor: tuple[float, float] = (0.0, 0.0)) -> PlanarDetection:
    return PlanarDetection(
        range_m=range_m,
        bearing_rad=bearing_rad,
        covariance=np.diag([0.04, 0.01]),
        sensor=np.array(sensor),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )


@pytest.mark.parametrize("sensor", [(0.0, 0.0), (0.4, -0.2)])
@pytest.mark.parametrize("has_range", [True, False])
def test_no_association_costs_less_than_the_bound(has_range: bool, sensor: tuple[float, float]) -> None:
    """The energy at the best of many modes, robot and object correlated, is that of the association."""
    random = np.random.default_rng(0)
    num_objects, robot = 40, np.array([0.5, -0.3, 0.4])
    objects = np.concatenate(
        [random.uniform(-12.0, 12.0, (num_objects, 2)), random.uniform(-3, 3, (num_objects, 1))], 1
    )
    factor = random.normal(size=(3 * (1 + num_objects), 3)) * np.tile([0.4, 0.4, 0.1], 1 + num_objects)[:, None]
    covariance = factor @ factor.T + 0.01 * np.eye(len(factor))
    items = [
        detection(3.0 if has_range else np.nan, 0.3, sensor),
        detection(7.0 if has_range else np.nan, -1.2, sensor),
    ]
    sigmas = np.sqrt([np.linalg.eigvalsh(covariance[i : i + 2, i : i + 2]).max() for i in range(3, len(factor), 3)])
    cost, log_peak = MODEL.least_cost(
        MODEL.collect(items), robot[None], covariance[None, :3, :3], objects[None], sigmas
    )
    spaces = Spaces.same(PlanarPoses())
    predicted = PredictedBelief(spaces.layout, np.concatenate([robot[None], objects])[None], covariance[None])
    starts = np.concatenate([np.zeros((1, 6)), random.normal(size=(9, 6))])
    for number, item in enumerate(items):
        rows = Assignments(
            parents=np.zeros(num_objects * 10, dtype=int), objects=np.repeat(np.arange(num_objects), 10)[:, None]
        )
        stack = KeyframeProblem.of(spaces, MODEL, predicted, MODEL.collect([item]), rows)
        energy = (
            stack.energy(find_modes(stack, np.tile(starts, (num_objects, 1))).y).reshape(num_objects, 10).min(axis=1)
        )
        assert (cost[0, number] <= energy + item.log_normaliser + 1e-9).all()
        assert (cost[0, number] > 2.0).sum() > 10 or not has_range
    assert log_peak == pytest.approx(sum(item.log_normaliser for item in items))


def beliefs(world: World) -> list[HybridBelief]:
    manager = Engine.of_run(run_of(world), InProcessPool(1))
    return [manager.process(keyframe) for keyframe in keyframes_of(world)]


@pytest.mark.parametrize("margin", [map_gate.FIRST_MARGIN, -15.0], ids=["as it is", "too narrow at first"])
def test_the_belief_is_that_of_all_objects(margin: float, monkeypatch: pytest.MonkeyPatch) -> None:
    world = grid_world(1, num_detections=2, num_keyframes=2, shape=(11, 10), noise=LOST)
    looked_at: list[int] = []
    enumerate_all = closed_keyframe.enumerate_associations

    def counting(setting, predicted):
        looked_at.append(predicted.mean.shape[1] - 1)
        return enumerate_all(setting, predicted)

    monkeypatch.setattr(closed_keyframe, "enumerate_associations", counting)
    monkeypatch.setattr(map_gate, "FIRST_MARGIN", margin)
    gated = beliefs(world)
    near, times = max(looked_at), len(looked_at)
    monkeypatch.setattr(closed_keyframe, "FEW_OBJECTS", len(world.object_means))
    everything = beliefs(world)
    assert near < len(world.object_means) / 2 and looked_at[-1] == len(world.object_means)
    assert times == 2 if margin > 0.0 else times > 2
    for mine, reference in zip(gated, everything, strict=True):
        same_mass = replace(
            mine, discarded_mass=reference.discarded_mass, discarded_mass_window=reference.discarded_mass_window
        )
        assert belief_difference(same_mass, reference) < 1e-9
        assert -1e-12 < mine.discarded_mass - reference.discarded_mass < 1e-3  # a bound on what was not looked at
