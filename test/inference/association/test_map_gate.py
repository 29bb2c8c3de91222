"""What range and bearing rule out: a bound that holds, and beliefs that do not depend on it."""

from dataclasses import replace

import numpy as np
import pytest
from semantic_slam_lab.grid.run import keyframes_of, run_of
from semantic_slam_lab.grid.world import Noise, World, grid_world
from semantic_slam_lab.studies.replay_scaling.study import belief_difference
from worlds.drives.standing_robot import beliefs_at_rest

from semantic_slam.configuration import Configuration
from semantic_slam.inference.association import closed_keyframe, map_gate
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem, PredictedBelief
from semantic_slam.inference.evidence.laplace import find_modes
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import POSES_IN_PLANE, PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

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
    spaces = POSES_IN_PLANE
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


def test_what_a_gate_leaves_out_is_no_more_for_placeholders_that_are_alike() -> None:
    """Three objects that the map lacks, of eight at most: what is really left out is less than a thousandth."""
    places = np.array([[3.0, 1.5], [3.0, -1.5], [4.5, 0.5], [2.0, 0.0]])
    unmapped = np.array([[2.5, 2.2], [3.6, -0.4], [5.0, 1.7]])
    known = MapPrior(tuple(ObjectPrior.planar(n, *at, sigma_m=0.1, sigma_rad=0.1) for n, at in enumerate(places)))
    configuration = Configuration.of(
        semantic_model={"kind": "none"},
        closed_world={
            "clutter_per_frame": 0.02,
            "unmapped_objects": 8,
            "unmapped_probability": 0.3,
            "displaced_share": 0.05,
        },
        weights={"method": "laplace"},
        pruning={"ratio": 1e12, "max_hypotheses": 20_000},
    )
    seen = [Detection.at(*at, covariance=0.05**2 * np.eye(2)) for at in (*places, *unmapped)]
    belief = beliefs_at_rest([seen], configuration, known)[-1]
    assert belief.discarded_mass < 0.05
