"""What the robot of chapter 4's scenarios does and measures, drawn from the models that the engine assumes."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.planar.frames import camera_in_object
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel
from semantic_slam_lab.studies.ch4.scenarios import Scenario, range_bearing, visible

TRUE_CLASS = 0
"""All objects are of one class, which the robot does not know."""


@dataclass(frozen=True)
class Frame:
    """Measurements of D objects at one keyframe."""

    seen: tuple[int, ...]  # (D,) objects, nearest first
    range_bearing: Array  # (D, 2) [m], [rad]
    azimuths: Array  # (D,) from where the camera sees each object, exact
    normals: Array  # (D, 2) standard normal numbers for the semantic noise


@dataclass(frozen=True)
class Run:
    """One robot in one world; keyframe k = 0 .. K - 1 here is the thesis's k + 1, whose measurements start at 1."""

    scenario: Scenario
    controls: Array  # (K, 3) as commanded, which the engine is given
    map_means: Array  # (O, 3) where the map says that the objects are
    start: Array  # (3,) true
    poses: Array  # (K, 3) true
    frames: tuple[Frame, ...]  # K

    @property
    def associations(self) -> tuple[tuple[int, ...], ...]:
        """The true beta_{1:k}."""
        return tuple(frame.seen for frame in self.frames)


def simulate(scenario: Scenario, controls: Array, generator: np.random.Generator, *, exact_map: bool = False) -> Run:
    """Everything but the classifier's outputs, so that runs of several models share it.

    The map errs as its covariance says, or with ``exact_map`` not at all; other draws are the same in both cases.
    """
    sigma_map = np.sqrt(scenario.object_variance)
    errors = se2.exp(generator.normal(size=scenario.objects.shape) * sigma_map * (0.0 if exact_map else 1.0))
    map_means = se2.compose(scenario.objects, se2.inverse(errors))
    pose, poses, frames = scenario.start, [], []
    for control in controls:
        noise = se2.exp(generator.normal(size=3) * np.sqrt(scenario.process_variance))
        pose = se2.compose(se2.compose(pose, control), noise)
        poses.append(pose)
        frames.append(_frame(scenario, pose, generator))
    return Run(scenario, controls, map_means, scenario.start, np.array(poses), tuple(frames))


def features(frame: Frame, model: ParametricModel) -> Array:
    """(D, 2) semantic measurements of a frame: Eq. 4.22 and its noise."""
    count = len(frame.seen)
    views = Viewpoints(frame.azimuths, np.zeros(count), np.ones(count))
    prediction = model.predict(np.full(count, TRUE_CLASS), views)
    root = np.linalg.cholesky(prediction.covariance)
    return np.asarray(prediction.mean + (root @ frame.normals[..., None])[..., 0])


def _frame(scenario: Scenario, pose: Array, generator: np.random.Generator) -> Frame:
    seen = visible(scenario, pose)
    objects, robot = scenario.objects[seen], np.broadcast_to(pose, (len(seen), 3))
    exact = np.stack(range_bearing(pose, objects), axis=-1)
    noise = generator.normal(size=exact.shape) * np.sqrt(scenario.range_bearing_variance)
    camera = camera_in_object(robot, objects, np.zeros(2))
    azimuths = np.arctan2(camera[:, 1], camera[:, 0])
    return Frame(tuple(seen.tolist()), exact + noise, azimuths, generator.normal(size=exact.shape))
