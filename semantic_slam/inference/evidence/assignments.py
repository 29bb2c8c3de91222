"""The table of a keyframe's candidates, from enumeration to weights; it gains columns on the way."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.states.observers import Observers

AT_MODES = (
    "log_evidence",
    "robot",
    "robot_covariance",
    "object_states",
    "object_covariances",
    "object_crosses",
    "bend",
    "innovation_nees",
)
"""Columns that are computed at the mode of a candidate."""
_OBSERVER = ("robot", "robot_covariance", "sensor", "sensor_covariance")


@dataclass(frozen=True, kw_only=True)
class Assignments:
    """K candidates over n detections, each of one parent; a column that is not known yet is None.

    States and covariances are those of robot and objects at the candidate's mode, in the tangent spaces there.
    """

    parents: Index  # (K,)
    objects: Index  # (K, n) position among the keyframe's objects, -1 clutter
    classes: Index | None = None  # (K, n) class of each object, -1 where classes are not enumerated
    numbers: Index | None = None  # (K,) mode of the candidate, 0: it is one Gaussian
    log_class_prior: Array | None = None  # (K,) of the classes first enumerated here
    log_evidence: Array | None = None  # (K,) log psi (Eq. 4.18) of geometry and factors, without that prior
    effective_sample_sizes: Array | None = None  # (K,) NaN where nothing was sampled
    robot: Array | None = None  # (K, s)
    robot_covariance: Array | None = None  # (K, r, r)
    sensor: Array | None = None  # (K, d) constant errors of the sensor
    sensor_covariance: Array | None = None  # (K, d, r + d) of these with the robot and among each other
    object_states: Array | None = None  # (K, n, s) of each detection's object
    object_covariances: Array | None = None  # (K, n, l, l)
    object_crosses: Array | None = None  # (K, n, r, l) covariances of the robot with each detection's object
    innovation_nees: Array | None = (
        None  # (K,) of the detections of known objects, per degree of freedom; NaN without any
    )
    bend: Array | None = None  # (K,) largest difference of a measurement at the mode from its linearisation, in sigmas
    outlier: Flags | None = None  # (K, n) detections that are taken for geometric outliers
    outlier_probability: Array | None = None  # (K, n) probability that they are
    posterior_modes: NDArray[np.object_] | None = None  # (K,) ``PosteriorMode`` of the window, None: not searched
    windows: NDArray[np.object_] | None = None  # (K,) ``Window`` since the candidate was last Gaussian, None: it is

    def __len__(self) -> int:
        return len(self.parents)

    def take(self, selection: Any) -> "Assignments":
        """The rows of a selection, any number of times."""
        some: dict[str, Any] = {
            name: column if column is None else column[selection] for name, column in vars(self).items()
        }
        return Assignments(**some)

    @classmethod
    def joined(cls, parts: Sequence["Assignments"]) -> "Assignments":
        """Assignments of several tables, one after another, with the columns that the first has."""
        known = [name for name, column in vars(parts[0]).items() if column is not None]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in known})

    def with_rows(self, rows: Index, others: "Assignments") -> "Assignments":
        """The assignments with the states and the evidence of ``others`` in some rows."""
        columns = {name: getattr(self, name).copy() for name in AT_MODES}
        for name, column in columns.items():
            column[rows] = getattr(others, name)
        return self.gaining(**columns)

    def column(self, name: str) -> Array:
        """A column that must have been filled already."""
        column = getattr(self, name)
        assert column is not None, name
        return np.asarray(column)

    def observers(self, rows: Index) -> Observers:
        """The robots in the plane and their sensors' constant errors at the modes of some rows."""
        return Observers.of(*(self.column(name)[rows] for name in _OBSERVER))

    def gaining(self, **columns: Any) -> "Assignments":
        """The assignments with more columns, or with columns replaced."""
        return replace(self, **columns)

    def object_ids(self, ids: Index) -> Index:
        """(K, n) ids, -1 clutter, where ``ids`` (O,) are those of the keyframe's objects."""
        return np.append(ids, -1)[self.objects]
