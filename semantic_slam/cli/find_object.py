"""``semantic_slam find BELIEF --object ID``: all that a map knows of one object."""

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from semantic_slam.answers.get_object import KnownObject

PROBABILITIES = ("existence", "moving", "moved", "missing")


def ask(belief: Path, which: str) -> None:
    """Print all that is known of the object with this name, or else this number; raises InputError."""
    from semantic_slam.answers.get_object import get_object
    from semantic_slam.evaluation.belief_bag import read_record

    print("\n".join(table(get_object(read_record(belief).beliefs[-1], which))))


def table(known: "KnownObject") -> list[str]:
    """Table with a row per quantity, and one per class, the likeliest first; ``-``: the run did not estimate it."""
    import numpy as np

    sigmas, degrees = np.sqrt(np.diagonal(known.covariance)), float(np.rad2deg(known.yaw_rad))
    quantities = {
        "object": str(known.object_id),
        "name": known.name,
        **{f"{axis} [m]": f"{known.pose[n]:.2f} +- {sigmas[n]:.2f}" for n, axis in enumerate("xyz")},
        "yaw [deg]": f"{degrees:.0f} +- {np.rad2deg(sigmas[5]):.0f}",
        **{name: _number(getattr(known, name)) for name in PROBABILITIES},
        "mutual information [nats]": _number(known.mutual_information),
        "views in coverage": "yes" if known.in_coverage else "no",
    }
    classes = sorted(known.class_probabilities.items(), key=lambda item: -item[1])
    quantities |= {f"class {name}": _number(probability) for name, probability in classes}
    width = max(map(len, quantities))
    return [f"{name:{width}}  {value}" for name, value in quantities.items()]


def _number(value: float) -> str:
    return "-" if isnan(value) else f"{value:.4f}"
