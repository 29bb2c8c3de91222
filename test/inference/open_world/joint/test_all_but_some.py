"""Conditioning on all blocks but one or two equals conditioning on these blocks alone."""

import numpy as np
import pytest

from semantic_slam.inference.open_world.joint.all_but_some import given_all_but

COUNT, SIZE = 5, 2


@pytest.mark.parametrize("without", [(0, -1), (4, -1), (1, 3), (4, 0), (2, 4)])
def test_the_others_tell_what_they_do_by_themselves(without: tuple[int, int]) -> None:
    """The last block, too, which is where -1 would point to."""
    random = np.random.default_rng(3)
    root = random.normal(size=((COUNT + 1) * SIZE,) * 2)
    joint, residual = root @ root.T, random.normal(size=COUNT * SIZE)
    covariance, cross = joint[SIZE:, SIZE:], joint[:SIZE, SIZE:]
    shift, known = given_all_but(residual, covariance, cross[None], np.array([without]))
    blocks = np.repeat([n not in without for n in range(COUNT)], SIZE)
    gain = np.linalg.solve(covariance[np.ix_(blocks, blocks)], cross[:, blocks].T).T
    np.testing.assert_allclose(shift[0], gain @ residual[blocks], atol=1e-10)
    np.testing.assert_allclose(known[0], gain @ cross[:, blocks].T, atol=1e-10)
