"""Class models from a table: mean scores of every class, seen from evenly spaced directions."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.class_models.kind import ClassModelKind
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.viewpoint.model import Prediction, Viewpoints


@dataclass(frozen=True)
class ViewpointTable:
    """C classes, F features, A azimuths in the middles of equal sectors; between them means are interpolated."""

    class_names: tuple[str, ...]
    feature_names: tuple[str, ...]
    means: Array  # (C, A, F)
    sigma: float  # of every feature

    @property
    def num_features(self) -> int:
        """F, what a classifier's feature must have."""
        return len(self.feature_names)

    def predict(self, classes: Index, viewpoints: Viewpoints) -> Prediction:
        """Prediction for class ``classes[b]`` at viewpoint b; (B,) class indices."""
        count = self.means.shape[1]
        place = np.asarray(viewpoints.azimuth_rad) * count / (2.0 * np.pi) - 0.5
        before = np.floor(place).astype(int)
        first, second = self.means[classes, before % count], self.means[classes, (before + 1) % count]
        jacobian = np.zeros((*first.shape, 3))  # by azimuth, elevation and range
        jacobian[:, :, 0] = (second - first) * count / (2.0 * np.pi)
        covariance = np.broadcast_to(self.sigma**2 * np.eye(self.num_features), (*first.shape, self.num_features))
        return Prediction(first + (place - before)[:, None] * (second - first), covariance, jacobian)

    def in_coverage(self, classes: Index, viewpoints: Viewpoints) -> Flags:
        """The table goes all around."""
        return np.ones(len(viewpoints.azimuth_rad), dtype=np.bool_)


def read_table(settings: SemanticModelConfiguration) -> ViewpointTable:
    """The table in the file ``semantic_model.path``, or the one beside this module. Raises InputError."""
    path = Path(settings.path) if settings.path else Path(__file__).with_name("table.json")
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        means = np.array(list(table["means"].values()), dtype=np.float64)
        return ViewpointTable(tuple(table["means"]), tuple(table["features"]), means, float(table["sigma"]))
    except (OSError, ValueError, KeyError, TypeError) as fault:
        raise InputError(f"{path}: not a table of viewpoints ({fault!r}); check semantic_model.path") from None


VIEWPOINT_TABLE = ClassModelKind(viewpoint=read_table)
