"""Smoothers grow together as one by one, and leave alone what they grew from."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from worlds.scenes.one_object import (
    CLASSES,
    LOOK,
    MANIFOLD,
    OBJECT,
    ROBOT,
    SPACES,
    STEP,
    TARGET,
    classed,
    detection,
    estimate,
    extend,
    num_real_factors,
    path,
    root,
    step,
)

from semantic_slam.geometry import se2
from semantic_slam.inference.models.linear_factors import linearisation_points
from semantic_slam.inference.smoothing.batch_update import Extension, update_all
from semantic_slam.inference.smoothing.errors import ConsumedSmootherError, LostComponentError
from semantic_slam.inference.smoothing.growth import only_children
from semantic_slam.inference.smoothing.semantic_factors import (
    SemanticFactor,
    SemanticFactorMaker,
)
from semantic_slam.inference.smoothing.smoother import Smoother


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


def test_a_lost_one_does_not_take_the_others_along() -> None:
    parent = root(SemanticFactorMaker(SPACES, CLASSES))
    broken = classed(0, 0.0)
    broken.graph.add(MANIFOLD.prior_factors(ROBOT[7], np.zeros(3), np.eye(3))[0])  # of a variable that is not there
    found = update_all([parent] * 3, [classed(0, 0.0), broken, classed(0, 0.2)])
    assert [isinstance(one, LostComponentError) for one in found] == [False, True, False]
    with pytest.raises(LostComponentError, match="update failed"):
        broken = classed(0, 0.0)
        broken.graph.add(MANIFOLD.prior_factors(ROBOT[7], np.zeros(3), np.eye(3))[0])
        extend(parent, broken)


def test_what_cannot_be_read_is_lost_alone() -> None:
    """A measurement that is not a number shows when states are read, not in the update."""
    semantics = SemanticFactorMaker(SPACES, CLASSES)
    good, bad = classed(0, 0.0), classed(0, 0.0)
    broken = replace(bad.measurements[0].detection, feature=np.array([np.nan, 0.2]))
    bad = replace(bad, measurements=[replace(bad.measurements[0], detection=broken)])
    found = update_all([root(semantics)] * 2, [good, bad])
    assert [isinstance(one, LostComponentError) for one in found] == [False, True]


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
        graph.add(MANIFOLD.prior_factors(key, mean, 0.5**2 * np.eye(3))[0])
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
