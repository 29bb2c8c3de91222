"""Start points of the search for a candidate's mode."""

from itertools import combinations

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.evidence.keyframe_problem import KeyframeProblem
from semantic_slam.inference.models.observation import TurnsByTwo

OPEN_HEADING_RAD = 0.5
"""Sigma of the robot's heading above which starts from pairs of detections are tried, too, as modes are far apart."""


def search_start(stack: KeyframeProblem) -> Array:
    """(B, n) the start of least energy among the prior mean and the robot states that explain one detection each."""
    best = np.zeros((len(stack.mean), stack.size))
    if len(best) == 0:
        return best
    least = stack.energy(best)
    size, robot = stack.layout.robot, stack.robots_of(stack.mean)
    for number in range(stack.rows.objects.shape[1]):
        wanted = stack.model.robot_start(stack.detections.take([number]), robot, stack.objects_of(stack.mean, number))
        start = np.zeros_like(best)
        tangent = stack.spaces.robot.local(robot, wanted)
        start[:, :size] = np.linalg.solve(stack.root[:, :size, :size], tangent[..., None])[..., 0]
        energy = np.where(stack.active[:, number], stack.energy(start), np.inf)
        better = energy < least
        best[better], least = start[better], np.minimum(least, energy)
    return _turned_start(stack, stack.model, best, least) if isinstance(stack.model, TurnsByTwo) else best


def _turned_start(stack: KeyframeProblem, model: TurnsByTwo, best: Array, least: Array) -> Array:
    """(B, n) the ``best`` start, of energies ``least`` (B,), or a better one from two detections if heading is open."""
    size, robot = stack.layout.robot, stack.robots_of(stack.mean)
    turn = stack.spaces.robot.vertical(robot)[:, None]
    is_open = np.linalg.norm((turn @ stack.root[:, :size])[:, 0], axis=-1) > OPEN_HEADING_RAD
    pairs = combinations(range(stack.rows.objects.shape[1] if is_open.any() else 0), 2)
    for one, other in pairs:
        objects = (stack.objects_of(stack.mean, number) for number in (one, other))
        wanted = model.turned_start(stack.detections.take([one, other]), robot, *objects)
        start = np.zeros_like(best)
        tangent = stack.spaces.robot.local(robot, wanted)
        start[:, :size] = np.linalg.solve(stack.root[:, :size, :size], tangent[..., None])[..., 0]
        energy = np.where(is_open & stack.active[:, one] & stack.active[:, other], stack.energy(start), np.inf)
        better = energy < least
        best[better], least = start[better], np.minimum(least, energy)
    return best
