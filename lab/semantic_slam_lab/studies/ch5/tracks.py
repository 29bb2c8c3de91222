"""A robot drives around an object with weak odometry and looks at it: its track with the learned factor alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.latent.factor import exact_factor
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.model import DescriptorBelief
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.simulation.catalogue import model_named
from semantic_slam_lab.simulation.orbit import orbit_views
from semantic_slam_lab.simulation.tour import CAMERA_HEIGHT_M
from semantic_slam_lab.studies.ch5.models import DEFAULT, FORMULATIONS, trained
from semantic_slam_lab.studies.ch5.views import measured

POSES = 18
TURN_RAD = np.deg2rad(300.0)
RADIUS_M, RADIUS_SPREAD_M = (1.8, 2.8), 0.25
SIGMA_STEP = np.array([0.08, 0.08, 0.08])
"""Odometry from pose to pose: metres ahead and aside, radians."""
SIGMA_START = np.array([0.15, 0.15, 0.1])
SIGMA_OBJECT = np.array([0.05, 0.05, 0.03])
ITERATIONS_ON_THE_WAY = 4
"""Iterations of an optimisation that later ones go on from."""
KNOWN_DESCRIPTOR_SIGMA = 1e-3
"""Standard deviation of a descriptor that counts as known, in units of the prior's."""


@dataclass(frozen=True)
class Smoothed:
    """The maximum of a track's posterior; poses x, y, yaw in the object's true frame."""

    poses: Array  # (K, 3)
    target: Array  # (3,) pose of the object, truly zero
    descriptor: Array  # (L,)


@dataclass(frozen=True)
class Located:
    """A track around one object and what was made of it; (K, 3) poses x, y, yaw in the object's true frame."""

    name: str
    number: int
    truth: Array
    dead_reckoning: Array
    drives: dict[str, "Drive"]  # by the model whose features they hold
    estimates: dict[str, Smoothed]

    @property
    def error_m(self) -> dict[str, Array]:
        """(K,) position errors by name; ``dead_reckoning`` among them."""
        tracks = {"dead_reckoning": self.dead_reckoning} | {name: end.poses for name, end in self.estimates.items()}
        return {name: self.errors_m(track) for name, track in tracks.items()}

    def errors_m(self, track: Array) -> Array:
        """(K,) position errors of a (K, 3) track."""
        return np.asarray(np.linalg.norm(track[:, :2] - self.truth[:, :2], axis=1))

    def ratio(self, name: str) -> float:
        """Mean error of an estimate over that of dead reckoning."""
        errors = self.error_m
        return float(errors[name].mean() / errors["dead_reckoning"].mean())


def located(name: str, number: int, seed: int, models: Sequence[str] = (*FORMULATIONS, DEFAULT)) -> Located:
    """One track: drawn, rendered, smoothed with every model with the descriptor unknown, and known if learned."""
    generator = keyed_generator("ch5_localization", name, number, seed)
    truth = _track(generator)
    steps = se2.compose(se2.inverse(truth[:-1]), truth[1:])
    odometry = se2.compose(steps, generator.normal(size=(POSES - 1, 3)) * SIGMA_STEP)
    start = se2.compose(truth[0], generator.normal(size=3) * SIGMA_START)
    target = generator.normal(size=3) * SIGMA_OBJECT
    reckoned = [start]
    for step in odometry:
        reckoned.append(se2.compose(reckoned[-1], step))
    views = list(orbit_views(name, _viewpoints(truth, name)))
    drives, estimates = {}, {}
    for formulation in models:
        model = trained(formulation)
        seen = measured(model, views, model.crops, number)
        drive = Drive(seen.features, seen.viewpoints.elevation_rad, start, odometry, target)
        drives[formulation], estimates[formulation] = drive, drive.smoothed(model.model, model.model.prior)
        known = _known(model.model, name)
        if known is not None:
            estimates[f"{formulation}_descriptor_known"] = drive.smoothed(model.model, known)
    return Located(name, number, truth, np.array(reckoned), drives, estimates)


def _track(generator: np.random.Generator) -> Array:
    """(K, 3) around the origin at a distance that changes slowly, heading along the way."""
    turns = generator.uniform(-np.pi, np.pi) + generator.choice([-1.0, 1.0]) * np.linspace(0.0, TURN_RAD, POSES)
    wave = np.sin(2.0 * turns + generator.uniform(-np.pi, np.pi))
    radius = generator.uniform(*RADIUS_M) + RADIUS_SPREAD_M * wave
    places = np.stack([radius * np.cos(turns), radius * np.sin(turns)], axis=1)
    ahead = np.gradient(places, axis=0)
    return np.column_stack([places, np.arctan2(ahead[:, 1], ahead[:, 0])])


def _viewpoints(track: Array, name: str) -> Viewpoints:
    """Viewpoints from where the robot's camera, turned to the object's middle, sees the object."""
    flat = np.hypot(track[:, 0], track[:, 1])
    above = CAMERA_HEIGHT_M - 0.5 * model_named(name).size[2]
    azimuth = np.arctan2(track[:, 1], track[:, 0])
    return Viewpoints(azimuth, np.arctan2(above, flat), np.hypot(flat, above))


def _known(model: LatentModel, name: str) -> DescriptorBelief | None:
    if name not in model.instances.names:
        return None
    row = model.instances.descriptors[model.instances.names.index(name)]
    return DescriptorBelief(row[None], KNOWN_DESCRIPTOR_SIGMA * model.prior.sigma)


@dataclass(frozen=True)
class Drive:
    """What the robot knows of a track."""

    features: Array  # (K, F)
    elevation_rad: Array  # (K,) as it follows from the box's range and the camera's tilt
    start: Array  # (3,)
    odometry: Array  # (K - 1, 3)
    target: Array  # (3,) prior mean of the object

    def smoothed(self, model: LatentModel, descriptor: DescriptorBelief) -> Smoothed:
        """The whole problem optimised again after every view, so that each starts near the truth."""
        graph, values = self._priors(descriptor)
        for number, feature in enumerate(self.features):
            if number:
                before = _planar(values.atPose2(_x(number - 1)))
                values.insert(_x(number), gtsam.Pose2(*se2.compose(before, self.odometry[number - 1])))
                noise = gtsam.noiseModel.Diagonal.Sigmas(SIGMA_STEP)
                step = gtsam.Pose2(*self.odometry[number - 1])
                graph.add(gtsam.BetweenFactorPose2(_x(number - 1), _x(number), step, noise))
            graph.add(self._factor(model, number, feature))
            values = self._optimised(
                model, graph, values, descriptor, first=number == 0, last=number == len(self.features) - 1
            )
        poses = np.array([_planar(values.atPose2(_x(number))) for number in range(len(self.features))])
        return Smoothed(poses, _planar(values.atPose2(_O)), np.asarray(values.atVector(_E)))

    def _priors(self, descriptor: DescriptorBelief) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for key, pose, sigma in ((_x(0), self.start, SIGMA_START), (_O, self.target, SIGMA_OBJECT)):
            graph.add(gtsam.PriorFactorPose2(key, gtsam.Pose2(*pose), gtsam.noiseModel.Diagonal.Sigmas(sigma)))
            values.insert(key, gtsam.Pose2(*pose))
        noise = gtsam.noiseModel.Diagonal.Sigmas(descriptor.sigma[0])
        graph.add(gtsam.PriorFactorVector(_E, descriptor.mean[0], noise))
        values.insert(_E, descriptor.mean[0])
        return graph, values

    def _factor(self, model: LatentModel, number: int, feature: Array) -> gtsam.NonlinearFactor:
        """Factor without range or bearing, for the feature and the elevation of its view alone."""
        size = len(feature)
        detection = PlanarDetection(
            range_m=np.nan,
            bearing_rad=np.nan,
            covariance=np.eye(2),
            sensor=np.zeros(2),
            feature=feature,
            feature_covariance=np.zeros((size, size)),
            elevation_rad=float(self.elevation_rad[number]),
        )
        factor: gtsam.NonlinearFactor = exact_factor(LatentObservation(model), detection, (_x(number), _O, _E))
        return factor

    def _optimised(
        self,
        model: LatentModel,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        prior: DescriptorBelief,
        *,
        first: bool,
        last: bool,
    ) -> gtsam.Values:
        """The best optimum from here; after the first view also from the encoder's guess of the descriptor."""
        starts = [values]
        if first and prior.sigma.mean() > KNOWN_DESCRIPTOR_SIGMA * model.prior.sigma.mean():
            encoded = gtsam.Values(values)
            encoded.update(_E, model.encode(self.features[:1]).mean[0])
            starts.append(encoded)
        parameters = gtsam.LevenbergMarquardtParams()
        if not (first or last):
            parameters.setMaxIterations(ITERATIONS_ON_THE_WAY)
        ends = [gtsam.LevenbergMarquardtOptimizer(graph, start, parameters).optimize() for start in starts]
        return min(ends, key=graph.error)


_O, _E = gtsam.symbol("o", 0), gtsam.symbol("e", 0)


def _x(number: int) -> int:
    return int(gtsam.symbol("x", number))


def _planar(pose: gtsam.Pose2) -> Array:
    return np.array([pose.x(), pose.y(), pose.theta()])
