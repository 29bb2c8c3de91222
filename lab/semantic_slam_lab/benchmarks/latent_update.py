"""iSAM2 with factors of a learned latent space: one update, one batch linearisation, one keyframe of a long drive."""

import gtsam
import numpy as np

from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import POSES_IN_PLANE, PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.smoothing.semantic_factors import LinearisationPoints, SemanticFactor, SemanticFactorMaker
from semantic_slam.inference.states.keys import DESCRIPTOR, descriptor_key, object_key, robot_key
from semantic_slam.latent.model import DescriptorModel
from semantic_slam_lab.benchmarks.row import Row, alternated

OBJECTS, POSES, DETECTIONS = 20, 200, 3
REPETITIONS, QUICK_REPETITIONS = 40, 10
SPACES = POSES_IN_PLANE
STEP = np.array([0.3, 0.0, 2.0 * np.pi / POSES])
RELINEARISED_POSE = np.full(3, 0.1)
"""GTSAM's default; descriptors enter by linear factors, which a relinearisation would leave as they are."""
RELINEARISED_DESCRIPTOR = 1.0
SIGMA_STEP, SIGMA_GEOMETRY = 0.02, np.array([0.03, 0.1])


def updates(quick: bool, seed: int) -> list[Row]:
    """Updates of a graph of 20 objects and 200 poses, each keyframe with 3 detections."""
    model = load_latent_model(SemanticModelConfiguration(kind="latent"))
    assert model is not None
    return measured(model, QUICK_REPETITIONS if quick else REPETITIONS, seed)


def measured(model: DescriptorModel, repetitions: int, seed: int) -> list[Row]:
    """Rows of the benchmark with any descriptor model."""
    world = Circuit(model, seed)
    frame = POSES
    isams = {latent: world.grown(POSES - repetitions, latent=latent) for latent in (True, False)}
    ours_next, peer_next = (
        iter([world.keyframe(k, latent=latent, plain=plain) for k in range(POSES - repetitions, POSES)])
        for latent, plain in ((True, 1), (False, 2))
    )
    ours, peer = alternated(
        lambda: isams[True].update(*next(ours_next)), lambda: isams[False].update(*next(peer_next)), repetitions
    )
    views = world.views(frame)
    batch, _ = alternated(lambda: world.linear(*views), lambda: None, repetitions)
    update = (
        f"{OBJECTS} objects, the last keyframes of {POSES}, {DETECTIONS} detections: update an ISAM2 with odometry,"
        f" {DETECTIONS} built-in bearing-range factors and {DETECTIONS} LinearContainerFactors over pose, object and a"
        f" descriptor of {model.num_dimensions}, whose linearisation is a row of its own; the peer has {2 * DETECTIONS}"
        " built-in factors instead, all along"
    )
    linear = (
        f"decoder, Jacobians and {DETECTIONS} LinearContainerFactors of a keyframe in one batch,"
        f" {model.num_features} features, against the 1 ms of the requirement"
    )
    return [
        Row("latent_update_vs_builtin", ours * 1e3, peer * 1e3, "ms", ours / peer, repetitions, update),
        Row("latent_linearisation", batch * 1e3, 1.0, "ms", batch * 1e3, repetitions, linear),
    ]


class Circuit:
    """A robot on a circle of objects: its iSAM2 with a latent factor per detection, and one with none."""

    def __init__(self, model: DescriptorModel, seed: int):
        geometry = PlanarObservation(None, PlanarVisibility())
        self.model, self._factors = model, SemanticFactorMaker(SPACES, geometry, LatentObservation(model))
        self._random = np.random.default_rng(seed)
        prior = model.prior
        noise = self._random.standard_normal((OBJECTS, model.num_dimensions))
        self.descriptors = prior.mean + prior.sigma * noise
        self.poses, self.objects = self._layout()
        self._motion = gtsam.noiseModel.Isotropic.Sigma(3, SIGMA_STEP)
        self._geometry = gtsam.noiseModel.Diagonal.Sigmas(SIGMA_GEOMETRY)
        self.seen = [self._frame(k) for k in range(POSES + 1)]

    def views(self, frame: int) -> tuple[list[SemanticFactor], LinearisationPoints]:
        """The semantic measurements of one keyframe, and where their factors are made."""
        detections, numbers = self.seen[frame]
        measurements = [
            SemanticFactor(
                robot_key=robot_key(frame),
                object_key=object_key(int(n)),
                detection=detection,
                assigned_class=-1,
                descriptor_key=descriptor_key(int(n)),
            )
            for detection, n in zip(detections, numbers, strict=True)
        ]
        x = np.tile(self.poses[frame], (len(numbers), 1))
        return measurements, LinearisationPoints.stacked(x, self.objects[numbers], self.descriptors[numbers])

    def linear(
        self, measurements: list[SemanticFactor], points: LinearisationPoints
    ) -> list[gtsam.LinearContainerFactor]:
        """The latent factors of one keyframe, made in one batch."""
        return self._factors.make([measurements], [points])[0]

    def _layout(self) -> tuple[Array, Array]:
        poses = [np.zeros(3)]
        for _ in range(POSES):
            poses.append(se2.compose(poses[-1], STEP))
        angles = 2.0 * np.pi * np.arange(OBJECTS) / OBJECTS
        radius = STEP[0] / STEP[2]
        centre = np.array([0.0, radius])
        ring = (radius + 1.5) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return np.array(poses), np.column_stack([centre + ring, self._random.uniform(-np.pi, np.pi, OBJECTS)])

    def _frame(self, k: int) -> tuple[list[PlanarDetection], Index]:
        """Detections of the nearest objects ahead."""
        relative = se2.between(np.broadcast_to(self.poses[k], self.objects.shape), self.objects)
        distance = np.hypot(relative[:, 0], relative[:, 1])
        numbers = np.argsort(np.where(relative[:, 0] > 0.0, distance, np.inf))[:DETECTIONS]
        x = np.tile(self.poses[k], (DETECTIONS, 1))
        views = SPACES.viewpoints(x, self.objects[numbers], np.zeros(2))
        prediction = self.model.predict(views, self.descriptors[numbers])
        features = prediction.mean + prediction.sigma * self._random.standard_normal(prediction.mean.shape)
        none = np.zeros((self.model.num_features, self.model.num_features))
        covariance = np.diag(SIGMA_GEOMETRY[::-1] ** 2)
        bearing = np.arctan2(relative[numbers, 1], relative[numbers, 0])
        rows = zip(distance[numbers], bearing, features, strict=True)
        return [
            PlanarDetection(
                range_m=float(r),
                bearing_rad=float(b),
                covariance=covariance,
                sensor=np.zeros(2),
                feature=f,
                feature_covariance=none,
            )
            for r, b, f in rows
        ], numbers

    def grown(self, length: int, *, latent: bool) -> gtsam.ISAM2:
        """The graph before keyframe ``length``; all objects enter with the first keyframe."""
        parameters = gtsam.ISAM2Params()
        parameters.relinearizeSkip = 1
        thresholds = gtsam.ISAM2ThresholdMap()
        for symbol in "xo":
            thresholds.insert((symbol, RELINEARISED_POSE))
        thresholds.insert((DESCRIPTOR, RELINEARISED_DESCRIPTOR * self.model.prior.sigma[0]))
        parameters.setRelinearizeThreshold(thresholds)
        isam = gtsam.ISAM2(parameters)
        for k in range(length):
            graph, values = self.keyframe(k, latent=latent, plain=1 if latent else 2)
            if k == 0:
                self._start(graph, values, latent=latent)
            isam.update(graph, values)
        return isam

    def keyframe(self, k: int, *, latent: bool, plain: int) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        """New factors, ``plain`` built-in ones per detection and latent ones, and the new pose."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        values.insert(robot_key(k), gtsam.Pose2(*self.poses[k]))
        if k:
            graph.add(gtsam.BetweenFactorPose2(robot_key(k - 1), robot_key(k), gtsam.Pose2(*STEP), self._motion))
        for detection, number in zip(*self.seen[k], strict=True):
            for _ in range(plain):
                own = (robot_key(k), object_key(int(number)), detection.direction, detection.range_m)
                graph.add(gtsam.BearingRangeFactorPose2(*own, self._geometry))
        for factor in self.linear(*self.views(k)) if latent else []:
            graph.add(factor)
        return graph, values

    def _start(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, *, latent: bool) -> None:
        wide = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.0, 1.0, 0.3]))
        graph.add(gtsam.PriorFactorPose2(robot_key(0), gtsam.Pose2(*self.poses[0]), self._motion))
        for n in range(OBJECTS):
            graph.add(gtsam.PriorFactorPose2(object_key(n), gtsam.Pose2(*self.objects[n]), wide))
            values.insert(object_key(n), gtsam.Pose2(*self.objects[n]))
            if latent:
                prior = self.model.prior
                sigma = gtsam.noiseModel.Diagonal.Sigmas(prior.sigma[0])
                graph.add(gtsam.PriorFactorVector(descriptor_key(n), prior.mean[0], sigma))
                values.insert(descriptor_key(n), self.descriptors[n])
