"""Which turntable views train, calibrate and validate, and which instances are held out whole."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.training.views import ObjectView

TRAIN_STEP_DEG = 12
"""Largest step between two angles that train, where the table stopped often enough; else every other stop trains."""
CALIBRATE_DEG, VALIDATE_DEG, TEST_PERIOD_DEG = 6, 18, 24
"""What follows from it for a table that stopped every 3 or 6 degrees."""


LEAST_ANGLES = 8
"""Angles of the table altogether, half of which train; ETH-80 has 16 all around."""


@dataclass(frozen=True)
class TurntableSplit:
    """Views told apart by the table's angle; ``held_out`` has every view of instances that nothing is fitted to."""

    train: list[ObjectView]
    calibrate: list[ObjectView]
    validate: list[ObjectView]
    held_out: list[ObjectView]

    def without(self, names: Sequence[str]) -> "TurntableSplit":
        """The split as if some instances were not there."""
        out = set(names)
        parts = (self.train, self.calibrate, self.validate, self.held_out)
        return TurntableSplit(*([view for view in part if view.class_name not in out] for part in parts))


def wanted_angle(angle_deg: int) -> bool:
    """Whether a view at that angle of BigBIRD's table belongs to any part of the split."""
    return angle_deg % CALIBRATE_DEG == 0


def split(views: Sequence[ObjectView], held_out: Sequence[str]) -> TurntableSplit:
    """The parts of ``views``; halfway between two angles that train, by turns one to calibrate and one to validate.

    Raises InputError when the table stopped too seldom, or a part is empty.
    """
    angles = sorted({view.angle_deg for view in views})
    stride = _stride(angles)
    rank = {angle: index % (2 * stride) for index, angle in enumerate(angles)}
    known = [view for view in views if view.class_name not in set(held_out)]
    parts = TurntableSplit(
        train=[view for view in known if rank[view.angle_deg] % stride == 0],
        calibrate=[view for view in known if rank[view.angle_deg] == stride // 2],
        validate=[view for view in known if rank[view.angle_deg] == stride // 2 + stride],
        held_out=[view for view in views if view.class_name in set(held_out)],
    )
    if not (parts.train and parts.calibrate and parts.validate):
        raise InputError(f"turntables: no object is left to learn from at {len(angles)} angles; give more objects")
    return parts


def _stride(angles_deg: Sequence[int]) -> int:
    """Stops of the table from one that trains to the next: an even number, two at least. Raises InputError."""
    if len(angles_deg) < LEAST_ANGLES:
        raise InputError(
            f"turntables: {len(angles_deg)} angles are too few to learn from and to judge by;"
            f" give {LEAST_ANGLES} at least (--step-deg 3 or 6), or download every angle"
        )
    step = float(np.median(np.diff(angles_deg)))
    return max(2, 2 * int(TRAIN_STEP_DEG / (2.0 * step)))


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
