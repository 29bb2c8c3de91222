"""Smoothers that grow together, and descriptors that settle where the decoder bends."""

from dataclasses import dataclass, replace

import gtsam
import numpy as np
import pytest
from worlds.views.harmonic_model import HarmonicModel

from semantic_slam.geometry import se2
from semantic_slam.inference.models.latent.factor import exact_factor
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.linear_factors import linearisation_points
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.smoothing import batch_update
from semantic_slam.inference.smoothing.batch_update import Extension, update_all
from semantic_slam.inference.smoothing.errors import ConsumedSmootherError, LostComponentError
from semantic_slam.inference.smoothing.growth import only_children
from semantic_slam.inference.smoothing.semantic_factors import (
    MOVED_DESCRIPTOR,
    LinearisationPoints,
    SemanticFactor,
    SemanticFactorMaker,
)
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.latent.model import LatentPrediction
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel

MANIFOLD = PlanarPoses()
SPACES = Spaces.same(MANIFOLD)
CLASSES = PlanarObservation(ParametricModel(0.25, 10.0), PlanarVisibility())
GEOMETRY = PlanarObservation(None, PlanarVisibility())
ROBOT = [gtsam.symbol("x", k) for k in range(10)]
TARGET, LOOK = gtsam.symbol("o", 0), gtsam.symbol("e", 0)
OBJECT = np.array([2.0, 0.3, 1.0])
STEP, STEP_SIGMA = np.array([0.2, 0.0, 0.15]), 0.03


@dataclass(frozen=True)
class Swinging:
    """A decoder that bends as sin 4e in every direction."""

    num_features: int = 4
    num_dimensions: int = 1
    noise: float = 0.05
    class_names: tuple[str, ...] = ()

    @property
    def prior(self):
        return HarmonicModel(num_dimensions=1).prior

    def predict(self, viewpoints: Viewpoints, descriptors: np.ndarray) -> LatentPrediction:
        azimuth = np.asarray(viewpoints.azimuth_rad)[:, None]
        e = descriptors[:, :1]
        orders = np.arange(1, 1 + self.num_features)
        wave, slope = np.cos(orders * azimuth), -orders * np.sin(orders * azimuth)
        bend, bend_slope = np.sin(4.0 * e), 4.0 * np.cos(4.0 * e)
        by_direction = np.stack([slope * bend, np.zeros_like(slope)], axis=-1)
        return LatentPrediction(
            wave * bend, np.full_like(wave, self.noise), by_direction, (wave * bend_slope)[..., None]
        )


@dataclass(frozen=True)
class Bent:
    """(e, e^2), wherever it is seen from. About e = 0, Gauss-Newton steps from e to -2 r e where r is left of e^2."""

    num_features: int = 2
    num_dimensions: int = 1
    class_names: tuple[str, ...] = ()

    @property
    def prior(self):
        return HarmonicModel(num_dimensions=1).prior

    def predict(self, viewpoints: Viewpoints, descriptors: np.ndarray) -> LatentPrediction:
        e = descriptors[:, :1]
        mean = np.concatenate([e, e**2], axis=1)
        by_descriptor = np.stack([np.ones_like(e), 2.0 * e], axis=1)
        return LatentPrediction(mean, np.full_like(mean, 0.1), np.zeros((len(e), 2, 2)), by_descriptor)


def extend(smoother: Smoother, extension: Extension) -> Smoother:
    """One alone."""
    found = update_all([smoother], [extension])[0]
    if isinstance(found, LostComponentError):
        raise found
    return found


def root(semantics: SemanticFactorMaker) -> Smoother:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key, mean, sigma in ((ROBOT[0], np.zeros(3), 0.1), (TARGET, OBJECT, 0.1)):
        graph.add(MANIFOLD.prior_factor(key, mean, sigma**2 * np.eye(3)))
        MANIFOLD.insert(values, key, mean)
    return Smoother.of(SPACES, semantics, graph, values)


def detection(x: np.ndarray, feature: np.ndarray) -> PlanarDetection:
    d = se2.between(x, OBJECT)
    size = len(feature)
    noise = np.diag([0.1, 0.05]) ** 2
    spread = 0.01 * np.eye(size) if size == 2 else np.zeros((size, size))
    return PlanarDetection(
        range_m=np.hypot(*d[:2]),
        bearing_rad=np.arctan2(d[1], d[0]),
        covariance=noise,
        sensor=np.zeros(2),
        feature=feature,
        feature_covariance=spread,
    )


def step(k: int, measurements: list[SemanticFactor], seen: PlanarDetection, guess: np.ndarray) -> Extension:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(MANIFOLD.between_factor(ROBOT[k], ROBOT[k + 1], STEP, STEP_SIGMA**2 * np.eye(3)))
    graph.add(CLASSES.geometry_factor(seen, (ROBOT[k + 1], TARGET)))
    MANIFOLD.insert(values, ROBOT[k + 1], guess)
    return Extension(graph=graph, values=values, measurements=measurements, start={ROBOT[k + 1]: guess, TARGET: OBJECT})


def classed(k: int, offset: float, jumped: bool = False) -> Extension:
    x = path(k + 1)
    seen = detection(x, np.array([0.3 + offset, 0.2]))
    extension = step(
        k,
        [SemanticFactor(robot_key=ROBOT[k + 1], object_key=TARGET, detection=seen, assigned_class=0)],
        seen,
        se2.compose(x, np.array([offset, 0.0, 0.0])),
    )
    return replace(extension, jumped=jumped)


def path(length: int) -> np.ndarray:
    x = np.zeros(3)
    for _ in range(length):
        x = se2.compose(x, STEP)
    return x


def estimate(smoother: Smoother) -> np.ndarray:
    return MANIFOLD.states(smoother.isam.calculateEstimate())


def test_together_is_as_one_by_one() -> None:
    semantics = SemanticFactorMaker(SPACES, CLASSES)
    offsets = (-0.4, 0.0, 0.1, 0.5)
    alone, together = [root(semantics)] * 4, [root(semantics)] * 4
    for k in range(5):
        alone = [extend(one, classed(k, f, k == 2)) for one, f in zip(alone, offsets, strict=True)]
        together = update_all(together, [classed(k, f, k == 2) for f in offsets])
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_allclose(estimate(one), estimate(other), atol=1e-10)
        np.testing.assert_allclose(
            one.joint_covariance([ROBOT[5], TARGET]), other.joint_covariance([ROBOT[5], TARGET]), atol=1e-12
        )


def test_growing_leaves_the_parent_as_it_was() -> None:
    parent = root(SemanticFactorMaker(SPACES, CLASSES))
    before = estimate(parent)
    update_all([parent, parent], [classed(0, 0.0), classed(0, 0.5, jumped=True)])
    assert np.array_equal(estimate(parent), before)


@pytest.mark.parametrize("fails", [False, True])
def test_an_only_child_may_consume_its_parent(fails: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the update was in vain: what it left behind in the smoother does not count twice."""
    kept, used = root(SemanticFactorMaker(SPACES, CLASSES)), root(SemanticFactorMaker(SPACES, CLASSES))
    updated = Smoother.updated

    def in_vain(*arguments: object) -> Smoother:
        updated(*arguments)  # type: ignore[arg-type]
        raise RuntimeError("indeterminate")

    for k in range(5):
        extension, parent = classed(k, 0.2), used
        with monkeypatch.context() as patch:
            if fails and k == 2:
                patch.setattr(Smoother, "updated", in_vain)
            kept = extend(kept, extension)
            used = update_all([parent], [extension], only_children([parent]))[0]
        with pytest.raises(ConsumedSmootherError, match="fork"):
            parent.states([TARGET])
    assert num_real_factors(used) == num_real_factors(kept)
    np.testing.assert_allclose(estimate(used), estimate(kept), atol=1e-4 if fails else 1e-12)
    covariances = [one.joint_covariance([ROBOT[5], TARGET]) for one in (used, kept)]
    np.testing.assert_allclose(*covariances, rtol=1e-3 if fails else 1e-9, atol=1e-6)


def test_a_consumed_smoother_says_so_whatever_it_is_asked() -> None:
    parent = root(SemanticFactorMaker(SPACES, CLASSES))
    kept = parent.fork()
    parent.joint_covariance([TARGET])  # what was read before is not answered from memory either
    assert parent.estimate is not None
    update_all([parent], [classed(0, 0.2)], [0])
    asked = [
        lambda: parent.estimate,
        lambda: parent.states([TARGET]),
        lambda: parent.joint_covariance([TARGET]),
        lambda: parent.covariances([TARGET]),
        lambda: parent.has(TARGET),
        parent.kept,
        parent.converged,
        parent.fork,
    ]
    for ask in asked:
        with pytest.raises(ConsumedSmootherError, match=r"fork\(\) it before"):
            ask()
    assert np.isfinite(estimate(kept)).all()


def num_real_factors(smoother: Smoother) -> int:
    graph = smoother.isam.getFactorsUnsafe()
    return sum(graph.exists(i) for i in range(graph.size()))


def test_a_lost_one_does_not_take_the_others_along() -> None:
    parent = root(SemanticFactorMaker(SPACES, CLASSES))
    broken = classed(0, 0.0)
    broken.graph.add(MANIFOLD.prior_factor(ROBOT[7], np.zeros(3), np.eye(3)))  # of a variable that is not there
    found = update_all([parent] * 3, [classed(0, 0.0), broken, classed(0, 0.2)])
    assert [isinstance(one, LostComponentError) for one in found] == [False, True, False]
    with pytest.raises(LostComponentError, match="update failed"):
        broken = classed(0, 0.0)
        broken.graph.add(MANIFOLD.prior_factor(ROBOT[7], np.zeros(3), np.eye(3)))
        extend(parent, broken)


@pytest.mark.parametrize("damped", [True, False])
def test_half_way_ends_a_swing(damped: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Undamped, the updates do not end."""
    calls = []
    renewed = batch_update._renewed
    monkeypatch.setattr(batch_update, "_renewed", lambda *parts: calls.append(parts) or renewed(*parts))
    if not damped:
        monkeypatch.setattr(batch_update, "_halfway", lambda now, fork, measurements: now)
    latent = LatentObservation(Bent())
    seen = detection(path(1), np.array([0.0, -0.7]))
    extension = step(
        0,
        [SemanticFactor(robot_key=ROBOT[1], object_key=TARGET, detection=seen, assigned_class=-1, descriptor_key=LOOK)],
        seen,
        path(1),
    )
    begin = np.array([0.3])
    extension.graph.add(gtsam.PriorFactorVector(LOOK, np.zeros(1), gtsam.noiseModel.Isotropic.Sigma(1, 1.0)))
    extension.values.insert(LOOK, begin)
    began = {**extension.start, LOOK: begin}
    grown = extend(root(SemanticFactorMaker(SPACES, GEOMETRY, latent)), replace(extension, start=began))
    assert (len(calls) < batch_update.MAX_UPDATES) == damped
    assert (abs(grown.descriptors([LOOK])[0, 0]) < MOVED_DESCRIPTOR) == damped


@pytest.mark.parametrize(
    ("thresholds", "converged", "renewed"),
    [(0.8, True, False), (1.2, True, False), (1.7, True, True), (1.2, False, True)],
)
def test_a_factor_hardly_off_waits_until_its_object_is_seen_again(
    thresholds: float, converged: bool, renewed: bool
) -> None:
    latent = LatentObservation(Bent())
    seen = detection(path(1), np.array([0.0, -0.7]))
    extension = step(
        0,
        [SemanticFactor(robot_key=ROBOT[1], object_key=TARGET, detection=seen, assigned_class=-1, descriptor_key=LOOK)],
        seen,
        path(1),
    )
    extension.graph.add(gtsam.PriorFactorVector(LOOK, np.zeros(1), gtsam.noiseModel.Isotropic.Sigma(1, 1.0)))
    extension.values.insert(LOOK, np.zeros(1))
    began = {**extension.start, LOOK: np.zeros(1)}
    smoother = extend(root(SemanticFactorMaker(SPACES, GEOMETRY, latent)), replace(extension, start=began))
    now = smoother.points([0])
    off = now.descriptors + thresholds * MOVED_DESCRIPTOR * latent.prior.sigma
    moved = replace(
        smoother,
        factor_table=replace(smoother.factor_table, points=LinearisationPoints.stacked(now.robots, now.objects, off)),
    )
    assert batch_update._to_renew(
        {7: batch_update._Fork(extension=extension, smoother=moved, converged=converged)}
    ) == {7: [0] if renewed else []}
    next_keyframe = batch_update._stale([moved], [[TARGET]])[0]
    assert next_keyframe.rows == ([0] if thresholds > 1.0 else [])


def test_what_cannot_be_read_is_lost_alone() -> None:
    """A measurement that is not a number shows when states are read, not in the update."""
    semantics = SemanticFactorMaker(SPACES, CLASSES)
    good, bad = classed(0, 0.0), classed(0, 0.0)
    broken = replace(bad.measurements[0].detection, feature=np.array([np.nan, 0.2]))
    bad = replace(bad, measurements=[replace(bad.measurements[0], detection=broken)])
    found = update_all([root(semantics)] * 2, [good, bad])
    assert [isinstance(one, LostComponentError) for one in found] == [False, True]


def test_a_factor_does_not_fall_behind_a_creeping_view() -> None:
    """An object that turns by less than a relinearisation per keyframe: its factors follow, a keyframe late at most."""
    semantics = SemanticFactorMaker(SPACES, CLASSES)
    smoother = root(semantics)
    for k in range(8):
        extension = classed(k, 0.0)
        turn = MANIFOLD.prior_factor(TARGET, OBJECT + np.array([0.0, 0.0, 0.07 * (k + 1)]), 1e-4 * 0.3**k * np.eye(3))
        extension.graph.add(turn)
        smoother = extend(smoother, extension)
    rows = smoother.linear_rows()
    now = smoother.points(rows)
    behind = np.abs(now.objects[:, 2] - smoother.factor_table.points.objects[:, 2])
    assert now.objects[0, 2] - OBJECT[2] > 0.4
    assert behind.max() < 0.1 + 0.08


@pytest.mark.parametrize(("jumped", "updates"), [(False, 8), (False, 1), (True, 8)])
@pytest.mark.parametrize("start", [0.05, 0.33, 0.8])
def test_descriptors_settle_at_the_optimum_and_every_view_counts_once(
    start: float, jumped: bool, updates: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By updates alone, where they do not suffice, and where the whole is optimised at once."""
    monkeypatch.setattr(batch_update, "MAX_UPDATES", updates)
    model = Swinging()
    latent = LatentObservation(model)
    smoother = root(SemanticFactorMaker(SPACES, GEOMETRY, latent))
    true = np.array([0.37])
    for k in range(4):
        x = path(k + 1)
        views = SPACES.viewpoints(x[None], OBJECT[None], np.zeros(2))
        seen = detection(x, model.predict(views, true[None]).mean[0] + 0.02)
        extension = step(
            k,
            [
                SemanticFactor(
                    robot_key=ROBOT[k + 1], object_key=TARGET, detection=seen, assigned_class=-1, descriptor_key=LOOK
                )
            ],
            seen,
            x,
        )
        begin = np.array([start]) if k == 0 else smoother.descriptors([LOOK])[0]
        if k == 0:
            prior = latent.prior_of(0)
            sigma = gtsam.noiseModel.Diagonal.Sigmas(prior.sigma[0])
            extension.graph.add(gtsam.PriorFactorVector(LOOK, prior.mean[0], sigma))
            extension.values.insert(LOOK, begin)
        began = {**extension.start, LOOK: begin}
        smoother = extend(
            smoother,
            Extension(
                graph=extension.graph,
                values=extension.values,
                measurements=extension.measurements,
                start=began,
                jumped=jumped,
            ),
        )
    factors = gtsam.NonlinearFactorGraph(smoother.isam.getFactorsUnsafe())
    assert sum(factors.exists(i) for i in range(factors.size())) == 2 + 1 + 4 * 3
    graph = smoother.kept()
    assert graph.size() == 2 + 1 + 4 * 2
    for measurements in smoother.factor_table.measurements:
        graph.add(exact_factor(latent, measurements.detection, measurements.keys))
    found = smoother.isam.calculateEstimate()
    best = gtsam.LevenbergMarquardtOptimizer(graph, found).optimize()
    np.testing.assert_allclose(found.atVector(LOOK), best.atVector(LOOK), atol=0.05)
    np.testing.assert_allclose(MANIFOLD.states(found), MANIFOLD.states(best), atol=0.01)
    assert abs(found.atVector(LOOK)[0] - true[0]) < 0.1


def test_a_robot_that_stands_on_an_object_is_not_lost() -> None:
    """A bearing over a millimetre: Cholesky gives such systems up."""
    smoother = extend(root(SemanticFactorMaker(SPACES, CLASSES)), classed(0, 0.0))
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(MANIFOLD.between_factor(ROBOT[1], ROBOT[2], se2.between(path(1), OBJECT), 0.01 * np.eye(3)))
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([1e-3, 1e-3]))
    graph.add(gtsam.BearingRangeFactorPose2(ROBOT[2], TARGET, gtsam.Rot2(), 1e-4, noise))
    at = se2.compose(OBJECT, np.array([-1e-4, 0.0, 0.0]))
    MANIFOLD.insert(values, ROBOT[2], at)
    seen = classed(1, 0.0).measurements[0].detection
    measurements = [SemanticFactor(robot_key=ROBOT[2], object_key=TARGET, detection=seen, assigned_class=0)]
    extension = Extension(graph=graph, values=values, measurements=measurements, start={ROBOT[2]: at, TARGET: OBJECT})
    with pytest.raises(RuntimeError, match="Indeterminate"):
        gtsam.ISAM2(smoother.isam).update(graph, values)
    grown = extend(smoother, extension)
    assert np.linalg.norm(grown.states([ROBOT[2]])[0, :2] - OBJECT[:2]) < 0.2
    factors = gtsam.NonlinearFactorGraph(grown.isam.getFactorsUnsafe())
    assert sum(factors.exists(i) for i in range(factors.size())) == 2 + 3 + 3


def test_a_state_that_is_not_there_is_an_error() -> None:
    smoother = root(SemanticFactorMaker(SPACES, CLASSES))
    with pytest.raises(KeyError):
        smoother.states([ROBOT[0], ROBOT[5]])


def test_linearisation_points_are_the_states() -> None:
    look, other = np.array([0.3, -1.0]), np.zeros(2)
    keys = [[(ROBOT[0], TARGET, LOOK), (ROBOT[1], TARGET, LOOK)], [], [(ROBOT[0], TARGET, LOOK)]]
    far = np.array([300.0, -200.0, 1e-10])  # where GTSAM's exponential map is least exact
    rows = [(path(3), OBJECT, look), (far, OBJECT, look), (path(1), path(4), other)]
    points = linearisation_points(SPACES, keys, np.array([np.concatenate(row) for row in rows]))
    one = {ROBOT[0]: path(3), ROBOT[1]: far, TARGET: OBJECT, LOOK: look}
    for own, point in zip([one, {}, {ROBOT[0]: path(1), TARGET: path(4), LOOK: other}], points, strict=True):
        assert sorted(point.keys()) == sorted(own)
        for key, state in own.items():
            found = point.atVector(key) if key == LOOK else MANIFOLD.state(point, key)
            np.testing.assert_allclose(found, state, atol=1e-12)


def test_a_part_of_a_known_joint_covariance_is_that_of_gtsam() -> None:
    smoother = extend(root(SemanticFactorMaker(SPACES, CLASSES)), classed(0, 0.1))
    smoother.joint_covariance([ROBOT[1], TARGET, ROBOT[0]])
    expected = smoother.isam.jointMarginalCovariance([ROBOT[0], ROBOT[1]]).fullMatrix()
    np.testing.assert_allclose(smoother.joint_covariance([ROBOT[0], ROBOT[1]]), expected, atol=1e-12)


def test_objects_that_nobody_has_seen_need_not_be_optimised(monkeypatch: pytest.MonkeyPatch) -> None:
    """Most of a large map: they stay where their priors have them, and the others come to where they would."""
    random = np.random.default_rng(4)
    far = {gtsam.symbol("o", n): np.append(random.uniform(-50.0, 50.0, 2), 0.5) for n in range(1, 60)}
    semantics = SemanticFactorMaker(SPACES, CLASSES)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for key, mean in {ROBOT[0]: np.zeros(3), TARGET: OBJECT, **far}.items():
        graph.add(MANIFOLD.prior_factor(key, mean, 0.5**2 * np.eye(3)))
        MANIFOLD.insert(values, key, mean)
    smoother = Smoother.of(SPACES, semantics, graph, values)
    seen = detection(np.array([0.4, -0.3, 0.2]), np.array([0.6, 0.4]))
    extension = replace(
        step(0, [SemanticFactor(robot_key=ROBOT[1], object_key=TARGET, detection=seen, assigned_class=1)], seen, STEP),
        jumped=True,
    )
    part = extend(smoother, extension)
    monkeypatch.setattr("semantic_slam.inference.smoothing.reoptimisation.FEW_VARIABLES", 1000)
    whole = extend(smoother, extension)
    tied = [ROBOT[0], ROBOT[1], TARGET]
    assert np.abs(MANIFOLD.local(part.states([ROBOT[0]])[0], np.zeros(3))).max() > 0.05
    np.testing.assert_allclose(part.states(tied), whole.states(tied), atol=1e-6)
    np.testing.assert_allclose(part.states(list(far)), list(far.values()), atol=1e-12)
