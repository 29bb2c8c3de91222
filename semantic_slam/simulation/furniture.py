"""The classes of simulated furniture: boxes whose faces are partly shared between classes.

Object frame: origin in the centre of the box, x out of the front, y to the object's left, z up. Azimuth 0 looks at the
front, 90 degrees at the object's left (+y) side.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ObjectModel:
    """One class; all its instances look the same."""

    name: str
    size: tuple[float, float, float]  # along x, y, z in metres
    front: str  # names of pictures in textures.PICTURES
    left: str
    back: str
    right: str
    top: str

    def faces(self) -> tuple["Face", ...]:
        """The five visible faces."""
        depth, width, height = (length / 2.0 for length in self.size)
        return (
            Face("front", self.front, (depth, 0, 0), (0, width, 0), (0, 0, height)),
            Face("left", self.left, (0, width, 0), (-depth, 0, 0), (0, 0, height)),
            Face("back", self.back, (-depth, 0, 0), (0, -width, 0), (0, 0, height)),
            Face("right", self.right, (0, -width, 0), (depth, 0, 0), (0, 0, height)),
            Face("top", self.top, (0, 0, height), (0, width, 0), (-depth, 0, 0)),
        )


@dataclass(frozen=True)
class Face:
    """A rectangle in the object frame, metres: its picture's x runs along ``right``, its picture's y against ``up``."""

    name: str
    picture: str
    centre: tuple[float, float, float]
    right: tuple[float, float, float]  # half extent, rightwards for who looks at the face
    up: tuple[float, float, float]  # half extent

    def corners(self) -> NDArray[np.float64]:
        """(4, 3) lower left, lower right, upper right, upper left, counter-clockwise from outside."""
        centre, right, up = np.array(self.centre), np.array(self.right), np.array(self.up)
        return np.array([centre - right - up, centre + right - up, centre + right + up, centre - right + up])


WOODEN = (0.62, 0.70, 0.62)
METAL = (0.56, 0.66, 0.78)

MODELS = {
    model.name: model
    for model in (
        ObjectModel("cabinet", METAL, "cabinet_front", "cabinet_side", "plain_back", "plain_side", "plain_top"),
        ObjectModel("chest", WOODEN, "chest_front", "chest_side", "planked_back", "planked_side", "planked_top"),
        ObjectModel("crate", WOODEN, "crate_front", "planked_side", "planked_back", "crate_side", "planked_top"),
        ObjectModel("desk", WOODEN, "desk_front", "planked_side", "planked_back", "planked_side", "planked_top"),
        ObjectModel("locker", METAL, "locker_front", "plain_side", "plain_back", "locker_side", "plain_top"),
    )
}
"""Class name -> model. Wooden classes share their back and a side, painted ones too."""
