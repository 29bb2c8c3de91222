"""Contract tests of state spaces and of robot/landmark space pairs: subclasses say how to sample states."""

from collections.abc import Callable

import gtsam
import numpy as np
import pytest

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.kinds.state_space import StateSpace
from semantic_slam.inference.states.spaces import Spaces

COUNT = 7
STEP = 1e-6


def differences(function: Callable[[Array], Array], size: int) -> Array:
    """(..., m, size) central differences of ``function`` (..., m) of a tangent vector, at 0."""
    columns = [(function(step) - function(-step)) / (2.0 * STEP) for step in STEP * np.eye(size)]
    return np.stack(columns, axis=-1)


class StateSpaceContract:
    """Subclasses supply ``space`` and sample states, and tangent vectors of up to 1 m or 1 rad."""

    space: StateSpace
    largest_propagated: float = 1.0  # size of the errors of which propagation is exact to 1e-9

    def states(self, random: np.random.Generator, count: int = COUNT) -> np.ndarray:
        """(count, s) sampled states, some more than half a turn apart."""
        raise NotImplementedError

    def point_in_map(self, state: np.ndarray, point: np.ndarray) -> np.ndarray:
        """Map coordinates (p,) of a point (p,) in the state's frame, written out by hand as a reference."""
        raise NotImplementedError

    @pytest.fixture
    def random(self) -> np.random.Generator:
        return np.random.default_rng(3)

    def tangents(self, random: np.random.Generator, count: int = COUNT) -> np.ndarray:
        return random.uniform(-1.0, 1.0, (count, self.space.tangent_size))

    def same(self, first: np.ndarray, second: np.ndarray) -> None:
        """Assert that both states are equal up to whole turns."""
        np.testing.assert_allclose(self.space.local(first, second), 0.0, atol=1e-9)

    def test_sizes(self, random: np.random.Generator) -> None:
        space, x = self.space, self.states(random)
        assert x.shape == (COUNT, space.storage_size)
        assert space.local(x, x[::-1]).shape == (COUNT, space.tangent_size)
        assert space.frame(x).shape == (COUNT, space.frame_size)
        np.testing.assert_array_equal(space.frame(x)[:, : space.storage_size], x)
        assert space.relinearize_threshold.shape == space.far.shape == (space.tangent_size,)
        assert space.origin.shape == (space.storage_size,)
        assert space.heading is None or 0 <= space.heading < space.tangent_size
        assert space.attitude is None or not space.position_slopes(x)[..., space.attitude].any()
        moving = space.position_slopes(x)[..., space.position_rows]
        np.testing.assert_allclose(
            moving @ np.swapaxes(moving, -1, -2), np.tile(np.eye(moving.shape[1]), (COUNT, 1, 1)), atol=1e-12
        )
        assert space == type(space)() and hash(space) == hash(type(space)())

    def test_exponential_and_logarithm_are_inverse(self, random: np.random.Generator) -> None:
        t = self.tangents(random)
        at_origin = self.space.exp(np.zeros_like(t))
        np.testing.assert_allclose(self.space.local(at_origin, self.space.exp(t)), t, atol=1e-9)

    def test_retraction_and_local_coordinates_are_inverse(self, random: np.random.Generator) -> None:
        x, y, t = self.states(random), self.states(random), self.tangents(random)
        np.testing.assert_allclose(self.space.local(x, self.space.retract(x, t)), t, atol=1e-9)
        self.same(self.space.retract(x, self.space.local(x, y)), y)

    def test_retraction_composes_with_the_exponential(self, random: np.random.Generator) -> None:
        x, t = self.states(random), self.tangents(random)
        self.same(self.space.retract(x, t), self.space.compose(x, self.space.exp(t)))
        self.same(self.space.placed(self.space.frame(x), self.space.exp(t)), self.space.retract(x, t))

    def test_composition_is_associative(self, random: np.random.Generator) -> None:
        a, b, c = (self.states(random) for _ in range(3))
        compose = self.space.compose
        self.same(compose(compose(a, b), c), compose(a, compose(b, c)))

    def test_between_undoes_composition(self, random: np.random.Generator) -> None:
        a, b = self.states(random), self.states(random)
        self.same(self.space.between(a, self.space.compose(a, b)), b)

    def test_steps_along_are_compositions(self, random: np.random.Generator) -> None:
        start, controls = self.states(random), self.states(random, 3)
        found = self.space.along(start, np.tile(controls, (COUNT, 1, 1)))
        x = start
        for number, control in enumerate(controls):
            x = self.space.compose(x, np.tile(control, (COUNT, 1)))
            self.same(self.space.wrapped(found[:, number]), x)

    def test_propagation_is_the_adjoint_of_the_control(self, random: np.random.Generator) -> None:
        """(x Exp(e)) u = (x u) Exp(F e), for large e too where Exp is the group's own."""
        x, u, e = self.states(random), self.states(random), self.largest_propagated * self.tangents(random)
        F = self.space.propagation(u)
        left = self.space.compose(self.space.retract(x, e), u)
        self.same(left, self.space.retract(self.space.compose(x, u), (F @ e[..., None])[..., 0]))

    def test_the_chart_s_slopes_by_differences(self, random: np.random.Generator) -> None:
        space, x, t = self.space, self.states(random), self.tangents(random)
        moved, chart = space.exp_and_jacobian(t)
        self.same(space.wrapped(moved), space.exp(t))
        at = space.retract(x, t)
        numeric = differences(lambda step: space.local(at, space.retract(x, t + step)), space.tangent_size)
        np.testing.assert_allclose(chart, numeric, atol=1e-7)

    def test_positions_and_their_slopes_by_differences(self, random: np.random.Generator) -> None:
        space, x = self.space, self.states(random)
        size = space.position(x).shape[-1]
        expected = [self.point_in_map(row, np.zeros(size)) for row in x]
        np.testing.assert_allclose(space.position(x), expected, atol=1e-12)
        numeric = differences(lambda step: space.position(space.retract(x, step)), space.tangent_size)
        np.testing.assert_allclose(space.position_slopes(x), numeric, atol=1e-7)

    def test_points_in_frame_and_their_slopes_by_differences(self, random: np.random.Generator) -> None:
        space, x = self.space, self.states(random)
        body = random.normal(size=space.position(x).shape)
        points = np.array([self.point_in_map(*pair) for pair in zip(x, body, strict=True)])
        seen, by_state, by_point = space.in_frame(x, points)
        np.testing.assert_allclose(seen, body, atol=1e-9)
        moved = differences(lambda step: space.in_frame(space.retract(x, step), points)[0], space.tangent_size)
        np.testing.assert_allclose(by_state, moved, atol=1e-7)
        elsewhere = differences(lambda step: space.in_frame(x, points + step)[0], points.shape[-1])
        np.testing.assert_allclose(by_point, elsewhere, atol=1e-7)

    def test_displacement_and_turning_back(self, random: np.random.Generator) -> None:
        space, x = self.space, self.states(random)
        body, origin = random.normal(size=(2, *space.position(x).shape))
        points = np.array([self.point_in_map(*pair) for pair in zip(x, body, strict=True)])
        np.testing.assert_allclose(space.displacement(x, body, origin), points - origin, atol=1e-9)
        np.testing.assert_allclose(space.turned_back(x, points - space.position(x)), body, atol=1e-9)

    def test_turns_about_the_vertical_leave_heights_and_the_position(self, random: np.random.Generator) -> None:
        space, x, angle = self.space, self.states(random), 0.3
        vertical, at, body = space.vertical(x), space.position(x), random.normal(size=space.position(x).shape)
        before = space.displacement(x, body, at)
        sine, cosine = (np.sin(angle), np.cos(angle)) if vertical.any() else (0.0, 1.0)
        expected = before.copy()
        expected[:, 0] = cosine * before[:, 0] - sine * before[:, 1]
        expected[:, 1] = sine * before[:, 0] + cosine * before[:, 1]
        np.testing.assert_allclose(
            space.displacement(space.retract(x, angle * vertical), body, at), expected, atol=1e-12
        )

    def test_rows_of_a_batch_are_single_states(self, random: np.random.Generator) -> None:
        space, x, y, t = self.space, self.states(random), self.states(random), self.tangents(random)
        pairs = {"compose": (x, y), "retract": (x, t), "local": (x, y), "between": (x, y), "exp": (t,)}
        for name, operands in {**pairs, "propagation": (x,), "poses": (x,), "frame": (x,)}.items():
            method = getattr(space, name)
            together = method(*operands)
            for row in range(COUNT):
                np.testing.assert_allclose(method(*(each[row] for each in operands)), together[row], atol=1e-12)

    def test_the_mean_of_copies_is_the_state(self, random: np.random.Generator) -> None:
        x, weights = self.states(random), np.full(4, 0.25)
        self.same(self.space.mean(np.tile(x, (4, 1, 1)), weights), x)

    def test_gtsam_gives_back_what_it_was_given(self, random: np.random.Generator) -> None:
        space, values, x = self.space, gtsam.Values(), self.states(random, 3)
        for key in (2, 0, 1):
            space.insert(values, key, x[key])
            self.same(space.state(values, key), x[key])
        self.same(space.states(values), x)

    def test_gtsam_s_factors_measure_local_coordinates(self, random: np.random.Generator) -> None:
        """Prior factors have the error |Log(mean^-1 x)|^2 / 2 (Mahalanobis); motion factors have it to first order."""
        space, values = self.space, gtsam.Values()
        root = random.normal(size=(space.tangent_size, space.tangent_size))
        covariance = root @ root.T + np.eye(len(root))
        x, control = self.states(random, 1)[0], self.states(random, 1)[0]
        off = 1e-4 * self.tangents(random, 1)[0]
        space.insert(values, 0, x)
        space.insert(values, 1, space.retract(space.compose(x, control), off))
        expected = 0.5 * off @ np.linalg.solve(covariance, off)
        assert space.between_factor(0, 1, control, covariance).error(values) == pytest.approx(expected, rel=1e-3)
        prior = space.prior_factors(0, space.retract(x, -off), covariance)
        assert sum(factor.error(values) for factor in prior) == pytest.approx(expected, rel=1e-3)


class SpacesContract:
    """Subclasses supply a pair of ``spaces`` and sample robots and landmarks."""

    spaces: Spaces

    def robots(self, random: np.random.Generator, count: int) -> np.ndarray:
        """(count, s) sampled robot states."""
        raise NotImplementedError

    def landmarks(self, random: np.random.Generator, count: int) -> np.ndarray:
        """(count, s) sampled landmark states."""
        raise NotImplementedError

    def camera_from_landmark(self, x: np.ndarray, o: np.ndarray, sensor: np.ndarray) -> np.ndarray:
        """(3,) camera position of one robot in the frame of one landmark, written out by hand as a reference."""
        raise NotImplementedError

    @pytest.fixture
    def random(self) -> np.random.Generator:
        return np.random.default_rng(5)

    def pairs(self, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        return self.robots(random, COUNT), self.landmarks(random, COUNT)

    def rows(self, random: np.random.Generator, robots: int = 1) -> np.ndarray:
        """(COUNT, 3 + robots, s) states: a robot, three landmarks, then further robots."""
        parts = [self.robots(random, COUNT), *(self.landmarks(random, COUNT) for _ in range(3))]
        parts += [self.robots(random, COUNT) for _ in range(robots - 1)]
        found = np.zeros((COUNT, len(parts), self.spaces.storage.width))
        for place, part in enumerate(parts):
            found[:, place, : part.shape[1]] = part
        return found

    @pytest.mark.parametrize("motions", [0, 2])
    def test_rows_are_states_of_their_own_spaces(self, random: np.random.Generator, motions: int) -> None:
        """Operations on an array of robot and landmark rows equal those of each row's own space."""
        spaces = self.spaces
        joint = spaces.joint_with_motions(3) if motions else spaces.joint
        x, y = self.rows(random, 1 + motions), self.rows(random, 1 + motions)
        t = random.uniform(-1.0, 1.0, (COUNT, 4 + motions, spaces.layout.width))
        moved, chart = joint.exp_and_jacobian(t)
        found = {
            "compose": (joint.compose(x, y), (x, y)),
            "retract": (joint.retract(x, t), (x, t)),
            "local": (joint.local(x, y), (x, y)),
            "exp": (joint.exp(t), (t,)),
        }
        placed = joint.placed(joint.frame(x), moved)
        for place in range(4 + motions):
            space = spaces.landmark if 1 <= place <= 3 else spaces.robot
            s, d = space.storage_size, space.tangent_size
            sizes = {id(x): s, id(y): s, id(t): d}
            for name, (values, operands) in found.items():
                own = getattr(space, name)(*(each[:, place, : sizes[id(each)]] for each in operands))
                np.testing.assert_allclose(values[:, place, : own.shape[-1]], own, atol=1e-12, err_msg=name)
            alone, slopes = space.exp_and_jacobian(t[:, place, :d])
            np.testing.assert_allclose(chart[:, place, :d, :d], slopes, atol=1e-12)
            own = space.placed(space.frame(x[:, place, :s]), alone)
            np.testing.assert_allclose(placed[:, place, :s], own, atol=1e-12)

    def test_relative_positions_and_their_slopes_by_differences(self, random: np.random.Generator) -> None:
        spaces, (x, o) = self.spaces, self.pairs(random)
        found = spaces.relative_position(x, o)
        robot, landmark = spaces.robot, spaces.landmark
        expected = robot.turned_back(x, landmark.position(o) - robot.position(x))
        np.testing.assert_allclose(found.point, expected, atol=1e-12)
        by_robot = differences(
            lambda step: spaces.relative_position(robot.retract(x, step), o).point, robot.tangent_size
        )
        by_landmark = differences(
            lambda step: spaces.relative_position(x, landmark.retract(o, step)).point, landmark.tangent_size
        )
        np.testing.assert_allclose(found.by_robot, by_robot, atol=1e-7)
        np.testing.assert_allclose(found.by_landmark, by_landmark, atol=1e-7)

    @pytest.mark.parametrize("sensor", [[0.0, 0.0, 0.0], [0.3, -0.2, 0.0], [0.2, 0.1, 1.4]])
    def test_viewpoints_are_those_of_the_camera(self, random: np.random.Generator, sensor: list[float]) -> None:
        """Viewpoints are azimuth about the landmark's vertical axis, elevation above its horizon, and range."""
        x, o = self.pairs(random)
        views = self.spaces.viewpoints(x, o, np.array(sensor))
        camera = np.array([self.camera_from_landmark(*pair, np.array(sensor)) for pair in zip(x, o, strict=True)])
        np.testing.assert_allclose(views.azimuth_rad, np.arctan2(camera[:, 1], camera[:, 0]), atol=1e-9)
        np.testing.assert_allclose(views.range_m, np.linalg.norm(camera, axis=1), atol=1e-9)
        np.testing.assert_allclose(views.elevation_rad, np.arcsin(camera[:, 2] / views.range_m), atol=1e-9)

    def test_gtsam_gives_back_all_states_by_key(self, random: np.random.Generator) -> None:
        """States come back landmarks first, as the keys sort; descriptors of equal length are not taken for states."""
        spaces, values = self.spaces, gtsam.Values()
        robots, landmarks = self.robots(random, 2), self.landmarks(random, 3)
        keyed = dict(zip([robot_key(-1), robot_key(0)], robots, strict=True))
        keyed |= dict(zip([object_key(n) for n in range(3)], landmarks, strict=True))
        for key, state in keyed.items():
            spaces.of(key).insert(values, key, state)
        found = spaces.states(values)
        assert found.shape == (5, spaces.storage.width)
        for key, row in zip(values.keys(), found, strict=True):
            np.testing.assert_allclose(spaces.own(key, row), keyed[key], atol=1e-12)

    def test_changes_are_held_against_the_thresholds_of_their_own(self, random: np.random.Generator) -> None:
        """The single iSAM2 delta above its own threshold is reported, among three landmarks and two robots."""
        spaces = self.spaces
        thresholds = [spaces.landmark.relinearize_threshold] * 3 + [spaces.robot.relinearize_threshold] * 2
        small = 0.9 * np.concatenate(thresholds)
        assert spaces.are_within(small, 5)
        for place in range(len(small)):
            large = small.copy()
            large[place] *= 1.2
            assert not spaces.are_within(large, 5)
            large[place] = np.nan
            assert not spaces.are_within(large, 5)

    def test_poses_of_messages_row_by_row(self, random: np.random.Generator) -> None:
        spaces, x = self.spaces, self.rows(random)
        root = random.normal(size=(COUNT, 4, spaces.layout.width, spaces.layout.width))
        spread = root @ np.swapaxes(root, -1, -2)
        poses, covariances = spaces.in_map(x, spread)
        assert poses.shape == (COUNT, 4, 7) and covariances.shape == (COUNT, 4, 6, 6)
        for place in range(4):
            space = spaces.landmark if place else spaces.robot
            s, d = space.storage_size, space.tangent_size
            np.testing.assert_array_equal(poses[:, place], space.poses(x[:, place, :s]))
            stated = space.covariances if place else space.moments
            expected = stated(x[:, place, :s], spread[:, place, :d, :d])
            np.testing.assert_allclose(covariances[:, place], expected, atol=1e-12)
