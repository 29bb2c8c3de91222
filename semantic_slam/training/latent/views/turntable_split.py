"""Which turntable views train, calibrate and validate, and which instances are held out whole."""

from collections import defaultdict
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
"""Angles of the instance with most of them, half of which train; ETH-80 has 16 all around."""


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

    Every instance that is not held out is split by its own angles, so that it trains whichever they are. Raises
    InputError when each was seen from too few of them, or a part is empty.
    """
    angles_deg: dict[str, set[int]] = defaultdict(set)
    for view in views:
        angles_deg[view.class_name].add(view.angle_deg)
    most = max(map(len, angles_deg.values()), default=0)
    if most < LEAST_ANGLES:
        raise InputError(
            f"turntables: {most} angles are too few to learn from and to judge by;"
            f" give {LEAST_ANGLES} at least (--step-deg 3 or 6), or download every angle"
        )
    quarters = {name: _quarters(sorted(own)) for name, own in angles_deg.items()}
    out = set(held_out)
    known = [(view, quarters[view.class_name][view.angle_deg]) for view in views if view.class_name not in out]
    parts = TurntableSplit(
        train=[view for view, quarter in known if quarter in (0.0, 2.0)],
        calibrate=[view for view, quarter in known if quarter == 1.0],
        validate=[view for view, quarter in known if quarter == 3.0],
        held_out=[view for view in views if view.class_name in out],
    )
    if not (parts.train and parts.calibrate and parts.validate):
        raise InputError(f"turntables: no object is left to learn from at {most} angles; give more objects")
    return parts


def _quarters(angles_deg: Sequence[int]) -> dict[int, float]:
    """{angle: place among the angles of one instance}, in quarters of what lies between every other one that trains."""
    stride = _stride(angles_deg)
    return {angle: (2.0 * index / stride) % 4.0 for index, angle in enumerate(angles_deg)}


def _stride(angles_deg: Sequence[int]) -> int:
    """Stops of the table from one that trains to the next: an even number, two at least."""
    step = float(np.median(np.diff([*angles_deg, angles_deg[0] + 360])))
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
