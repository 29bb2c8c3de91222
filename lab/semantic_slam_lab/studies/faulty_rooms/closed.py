"""One drive of a lost robot through a closed room with a fault: was it lost for good, and was the fault named?"""

import time
from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import ClosedWorldConfiguration, Configuration, load_configuration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.evidence.model_fit import UNEXPLAINED
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.studies.faulty_rooms.closed_room import make_room, normalised_error, position_error_m, run
from semantic_slam_lab.studies.faulty_rooms.faults import FAULTS, FaultyRoom
from semantic_slam_lab.studies.faulty_rooms.knowable import moved_if_associations_were_known

RIGHT, NAMED, SURE = 0.9, 0.5, 0.9
"""Mean weight of what is right from which on a robot is not lost; of a statement; of one that must not be wrong."""
NEAR_M = 1.0
"""From its true place an object that the map lacks is named."""
CONFIGURATIONS = ("default", "known_map")


@dataclass(frozen=True, kw_only=True)
class Driven:
    """What came of one room."""

    seed: int
    is_lost: bool  # in the second half of the drive
    is_named: bool | None  # the fault, at the end; None: nothing is to be named
    is_nameable: bool | None  # what was displaced, by who is told what each detection is of; None: nothing was
    sure_and_wrong: int  # statements at the end, and associations in the second half
    position_error_m: float
    nees: float  # of the position at the end, per degree of freedom
    unexplained: int  # keyframes
    first_unexplained: int | None
    cpu_s: float


def configuration(name: str) -> Configuration:
    """A shipped one."""
    return load_configuration(configuration_file(name))


def driven_room(fault: str, name: str, seed: int, num_keyframes: int) -> Driven:
    """Draw a room, make it wrong, drive through it."""
    faulty = FAULTS[fault](make_room(seed, num_keyframes), seed)
    own, begin = configuration(name), time.process_time()
    beliefs = run(faulty.room, own)
    spent = time.process_time() - begin
    last, late = beliefs[-1], range(num_keyframes // 2, num_keyframes)
    shares = [right_shares(faulty, beliefs[k], k) for k in late]
    told = [k for k, belief in enumerate(beliefs) if belief.unexplained > UNEXPLAINED]
    return Driven(
        seed=seed,
        is_lost=bool(np.mean([np.prod(own) for own in shares]) < RIGHT),
        is_named=named(faulty, last),
        is_nameable=nameable(faulty, own.closed_world),
        sure_and_wrong=wrong_statements(faulty, last) + sum(p < 1.0 - SURE for own in shares for p in own),
        position_error_m=position_error_m(faulty.room, last),
        nees=normalised_error(faulty.room, last) / 2.0,
        unexplained=len(told),
        first_unexplained=told[0] if told else None,
        cpu_s=spent,
    )


def right_shares(faulty: FaultyRoom, belief: HybridBelief, keyframe: int) -> list[float]:
    """(D,) probability of what may rightly be said of each detection: its object, or none of the map's.

    Of an object that stands elsewhere either is right.
    """
    mapped = {item.object_id for item in faulty.room.prior.objects}
    of_none = [row for row, number in enumerate(belief.object_ids.tolist()) if number not in mapped] + [-1]
    rows = {number: row for row, number in enumerate(belief.object_ids.tolist())}
    shares = []
    for number, told in zip(faulty.wrong_at(keyframe), belief.association_probabilities, strict=True):
        accepted = [rows[number]] if number in mapped else []
        if number not in mapped or number in faulty.displaced:
            accepted += of_none
        shares.append(float(told[accepted].sum()))
    return shares


def named(faulty: FaultyRoom, belief: HybridBelief) -> bool | None:
    """Whether every object that the map lacks or has elsewhere is said to be so."""
    if not faulty.missing and not faulty.displaced:
        return None
    stated = _unmapped(faulty, belief, NAMED)
    by_id = dict(zip(belief.object_ids.tolist(), belief.moved.tolist(), strict=True))
    return all(
        by_id.get(number, 0.0) > NAMED or bool((_distances(faulty, stated, number) < NEAR_M).any())
        for number in faulty.missing | faulty.displaced
    )


def nameable(faulty: FaultyRoom, settings: ClosedWorldConfiguration) -> bool | None:
    """Whether the data tell of everything displaced that it was, by the shares that a configuration states."""
    if not faulty.displaced or settings.displaced_share <= 0.0:
        return None
    moved = moved_if_associations_were_known(faulty, settings.displaced_share, settings.displaced_sigma_m)
    return bool((moved[sorted(faulty.displaced)] > NAMED).all())


def wrong_statements(faulty: FaultyRoom, belief: HybridBelief) -> int:
    """Objects that are surely said to be not on the map, or moved, and are not."""
    stated = _unmapped(faulty, belief, SURE)
    true = [_distances(faulty, stated, number) < NEAR_M for number in faulty.missing | faulty.displaced]
    false = len(stated) - int(np.any(true, axis=0).sum()) if true else len(stated)
    moved = belief.object_ids[belief.moved > SURE].tolist()
    return false + sum(number not in faulty.displaced for number in moved)


def _unmapped(faulty: FaultyRoom, belief: HybridBelief, least: float) -> np.ndarray:
    """(N, 2) places of objects that the map lacks and that are stated with more than ``least``."""
    mapped = [item.object_id for item in faulty.room.prior.objects]
    chosen = ~np.isin(belief.object_ids, mapped) & (belief.existence > least)
    return np.asarray(belief.object_poses[chosen, :2])


def _distances(faulty: FaultyRoom, places: np.ndarray, number: int) -> np.ndarray:
    return np.asarray(np.linalg.norm(places - faulty.room.objects[number, :2], axis=1))
