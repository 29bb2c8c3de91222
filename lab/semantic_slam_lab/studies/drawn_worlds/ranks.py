"""One world run: where the truth lies in what the belief at the end says, one draw for every quantity."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from semantic_slam.configuration import Configuration
from semantic_slam.evaluation.history import associated_objects, best_history, histories
from semantic_slam.evaluation.mixture import pose_error, position_region
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.models.odometry_bias import NAMES
from semantic_slam_lab.studies.drawn_worlds.worlds import DrawnWorld

AXES = {"x": 0, "y": 1, "yaw": 5}


@dataclass(frozen=True)
class Stated:
    """A yes or no that the belief gives a probability."""

    probability: float
    holds: bool

    def rank(self, random: np.random.Generator) -> float:
        """Even in [0, 1] where the probability is right: a rank with a tie broken by chance."""
        u = float(random.random())
        return self.probability * u if self.holds else self.probability + (1.0 - self.probability) * u


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One world; a quantity that it does not have is left out."""

    ranks: dict[str, float]  # of continuous quantities
    stated: dict[str, Stated]
    held: float  # share of keyframes whose 95 % region of the position holds the truth


def outcome_of(configuration: Configuration, world: DrawnWorld, random: np.random.Generator) -> Outcome:
    """Run the engine over ``world``; keyframe, object and pair are drawn."""
    engine = Engine(configuration)
    beliefs = [engine.process(keyframe) for keyframe in world.keyframes]
    k = int(random.integers(len(beliefs)))
    ranks = {f"robot {name}": _pose_rank(beliefs[k], world.poses[k], axis) for name, axis in AXES.items()}
    ranks |= _bias_ranks(beliefs[-1], world.biases) | _object_ranks(beliefs, world, random)
    held = [_held(belief, pose) for belief, pose in zip(beliefs, world.poses, strict=True)]
    stated = _existence(beliefs, world, random) | _pair(beliefs, world, random)
    return Outcome(ranks=ranks, stated=stated, held=float(np.mean(held)))


def _pose_rank(belief: HybridBelief, pose: Array, axis: int) -> float:
    """Distribution function of the mixture at the truth, along one axis of map."""
    errors = -pose_error(belief.poses, pose_vector_from_planar(pose))[:, axis]
    return float(np.exp(belief.log_weights) @ ndtr(errors / np.sqrt(belief.pose_covariances[:, axis, axis])))


def _bias_ranks(belief: HybridBelief, biases: Array) -> dict[str, float]:
    found = {}
    for name, bias in zip(NAMES, biases, strict=True):
        if name in belief.noise_names:
            at = belief.noise_names.index(name)
            found[name] = float(ndtr((bias - belief.noise_values[at]) / belief.noise_sigmas[at]))
    return found


def _object_ranks(beliefs: Sequence[HybridBelief], world: DrawnWorld, random: np.random.Generator) -> dict[str, float]:
    """Ranks of an object that the best hypothesis ties to a true one by two detections or more."""
    last = beliefs[-1]
    votes: dict[int, list[int]] = {}
    for known, labels in zip(best_history(beliefs), world.detected, strict=True):
        assert known is not None  # every keyframe is there
        for number, label in zip(known.tolist(), labels, strict=True):
            votes.setdefault(number, []).append(label)
    ids = last.object_ids.tolist()
    sure = [
        n for n, labels in votes.items() if n in ids and len(labels) > 1 and len(set(labels)) == 1 and labels[0] >= 0
    ]
    if not sure:
        return {}
    number = sorted(sure)[int(random.integers(len(sure)))]
    row, place = ids.index(number), world.objects[votes[number][0]]
    sigma = np.sqrt(np.diag(last.object_covariances[row])[:2])
    found = ndtr((place - last.object_poses[row, :2]) / sigma)
    return {"object x": float(found[0]), "object y": float(found[1])}


def _existence(beliefs: Sequence[HybridBelief], world: DrawnWorld, random: np.random.Generator) -> dict[str, Stated]:
    """Whether what a detection started is an object that had not been detected before."""
    starts = _starts(world)
    keyframes = [k for k, belief in enumerate(beliefs) if set(belief.object_ids.tolist()) & starts.keys()]
    if not keyframes:
        return {}
    belief = beliefs[keyframes[int(random.integers(len(keyframes)))]]
    rows = [row for row, number in enumerate(belief.object_ids.tolist()) if number in starts]
    row = rows[int(random.integers(len(rows)))]
    return {"existence": Stated(float(belief.existence[row]), starts[int(belief.object_ids[row])])}


def _starts(world: DrawnWorld) -> dict[int, bool]:
    """Id of the object that each detection would start -> whether it is the first one of a true object."""
    found: dict[int, bool] = {}
    known = {-1}
    for labels in world.detected:
        for label in labels:
            found[len(found)] = label not in known
        known |= set(labels)
    return found


def _pair(beliefs: Sequence[HybridBelief], world: DrawnWorld, random: np.random.Generator) -> dict[str, Stated]:
    """Whether the newest detection of one keyframe and one of the few before it are of one object."""
    objects = [associated_objects(belief) for belief in beliefs]
    labels = [np.array(own, dtype=int) for own in world.detected]
    k = [k for k in range(1, len(beliefs)) if len(labels[k]) and len(labels[k - 1])]
    if not k:
        return {}
    now = k[int(random.integers(len(k)))]
    belief = beliefs[now]
    before = histories(beliefs[: now + 1])[now - 1]
    one, other = int(random.integers(len(labels[now]))), int(random.integers(len(labels[now - 1])))
    same = (objects[now][:, one] == before[:, other]) & (before[:, other] >= 0)
    holds = labels[now][one] == labels[now - 1][other] and labels[now][one] >= 0
    return {"pair": Stated(float(np.exp(belief.log_weights) @ same), bool(holds))}


def _held(belief: HybridBelief, pose: Array) -> bool:
    weights, covariances = np.exp(belief.log_weights), belief.pose_covariances[:, :2, :2]
    return position_region(weights, belief.poses[:, :2], covariances, pose[:2])[0]
