"""The solver for many small least squares: where it ends, and that problems do not know of each other."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.levenberg_marquardt import LevenbergMarquardt, Minimum, minimise


@dataclass(frozen=True)
class Rosenbrock:
    """Residuals (a - x, b (y - x^2)) of B problems: a curved valley with its minimum at (a, a^2)."""

    a: Array  # (B,)
    b: float = 10.0

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        residual = np.stack([self.a - y[:, 0], self.b * (y[:, 1] - y[:, 0] ** 2)], axis=1)
        slope = np.zeros((len(y), 2, 2))
        slope[:, 0, 0], slope[:, 1, 0], slope[:, 1, 1] = -1.0, -2.0 * self.b * y[:, 0], self.b
        gradient = np.einsum("brn,br->bn", slope, residual)
        return 0.5 * (residual**2).sum(axis=1), gradient, slope.transpose(0, 2, 1) @ slope

    def select(self, selection: Index) -> "Rosenbrock":
        return Rosenbrock(self.a[selection], self.b)


A = np.array([1.0, -0.5, 2.0])
STARTS = np.array([[-1.2, 1.0], [3.0, -2.0], [0.0, 0.0]])


def test_curved_valleys_are_followed_to_their_ends() -> None:
    found = minimise(Rosenbrock(A), STARTS, max_iterations=100)
    np.testing.assert_allclose(found.y, np.column_stack([A, A**2]), atol=1e-6)
    np.testing.assert_allclose(found.energy, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.hessian[:, 0, 0], 1.0 + 400.0 * A**2, rtol=1e-5)


def test_a_problem_alone_ends_at_the_same_bits() -> None:
    together = minimise(Rosenbrock(A), STARTS)
    for row in range(3):
        alone = minimise(Rosenbrock(A[[row]]), STARTS[[row]])
        assert np.array_equal(alone.y[0], together.y[row]) and alone.energy[0] == together.energy[row]


def test_no_step_leads_upwards() -> None:
    search = LevenbergMarquardt(Rosenbrock(A), STARTS)
    before = search.energy
    for _ in range(20):
        search.advance(1, np.zeros(3))
        assert np.all(search.energy <= before)
        before = search.energy.copy()


def test_of_two_ends_the_lower_counts_problem_by_problem() -> None:
    first = Minimum(np.zeros((2, 1)), np.array([1.0, 2.0]), np.ones((2, 1, 1)))
    second = Minimum(np.ones((2, 1)), np.array([2.0, 1.0]), np.full((2, 1, 1), 3.0))
    best = first.or_lower(second)
    assert best.y.tolist() == [[0.0], [1.0]] and best.energy.tolist() == [1.0, 1.0]
    assert best.hessian.ravel().tolist() == [1.0, 3.0]


def test_a_search_goes_on_from_the_lower_of_two_points_as_if_begun_there() -> None:
    search, other = (LevenbergMarquardt(Rosenbrock(A), starts) for starts in (STARTS, STARTS[::-1]))
    lower = other.energy < search.energy
    assert lower.any() and not lower.all()
    search.take_lower(other)
    begun = LevenbergMarquardt(Rosenbrock(A), np.where(lower[:, None], STARTS[::-1], STARTS))
    np.testing.assert_array_equal(search.y, begun.y)
    np.testing.assert_array_equal(search.next_step()[0], begun.next_step()[0])
    assert search.energy.tolist() == begun.energy.tolist()
