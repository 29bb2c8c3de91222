"""Which turntable views train, calibrate and validate, and which instances are held out whole."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.training.views import ObjectView

TRAIN_STEP_DEG = 12
CALIBRATE_DEG, VALIDATE_DEG, TEST_PERIOD_DEG = 6, 18, 24
"""Halfway between two views that train, by turns one to calibrate and one to validate."""


@dataclass(frozen=True)
class TurntableSplit:
    """Views told apart by the table's angle; ``held_out`` has every view of instances that nothing is fitted to."""

    train: list[ObjectView]
    calibrate: list[ObjectView]
    validate: list[ObjectView]
    held_out: list[ObjectView]


def wanted_angle(angle_deg: int) -> bool:
    """Whether a view at that angle belongs to any part of the split."""
    return angle_deg % TRAIN_STEP_DEG == 0 or angle_deg % TEST_PERIOD_DEG in (CALIBRATE_DEG, VALIDATE_DEG)


def split(views: Sequence[ObjectView], held_out: Sequence[str]) -> TurntableSplit:
    """The parts of ``views``; raises InputError when one is empty that must not be."""
    known = [view for view in views if view.class_name not in set(held_out)]
    parts = TurntableSplit(
        train=[view for view in known if view.angle_deg % TRAIN_STEP_DEG == 0],
        calibrate=[view for view in known if view.angle_deg % TEST_PERIOD_DEG == CALIBRATE_DEG],
        validate=[view for view in known if view.angle_deg % TEST_PERIOD_DEG == VALIDATE_DEG],
        held_out=[view for view in views if view.class_name in set(held_out)],
    )
    if not (parts.train and parts.calibrate and parts.validate):
        raise InputError(
            f"turntables: no views at multiples of {TRAIN_STEP_DEG} degrees or halfway between them;"
            " render with --step-deg 3 or 6, or download every angle"
        )
    return parts


def choose_held_out(names: Sequence[str], classes: Mapping[str, str], count: int, seed: int) -> tuple[str, ...]:
    """``count`` instances, from class to class in turn; a class keeps two at least.

    ``classes`` {instance: class} may be empty: all are then of one class. Raises InputError when too few are left.
    """
    generator = np.random.default_rng((seed, 7))
    of_class: dict[str, list[str]] = {}
    for name in sorted(names):
        of_class.setdefault(classes.get(name, ""), []).append(name)
    spare = [list(generator.permutation(of_class[name]))[2:] for name in sorted(of_class)]
    rounds = [group[turn] for turn in range(max(map(len, spare))) for group in spare if turn < len(group)]
    if len(rounds) < count:
        raise InputError(f"--held-out {count}: only {len(rounds)} instances can be spared; hold out fewer")
    return tuple(sorted(str(name) for name in rounds[:count]))
