"""The classes of simulated furniture: boxes whose faces are partly shared between classes.

Object frame: origin in the centre of the box, x out of the front, y to the object's left, z up. Azimuth 0 looks at the
front, 90 degrees at the object's left (+y) side.
"""

from dataclasses import dataclass

from semantic_slam_lab.simulation.surface import Surface, rectangle


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

    def surfaces(self) -> tuple[Surface, ...]:
        """The five visible faces."""
        depth, width, height = (length / 2.0 for length in self.size)
        return (
            rectangle("front", self.front, (depth, 0, 0), (0, width, 0), (0, 0, height)),
            rectangle("left", self.left, (0, width, 0), (-depth, 0, 0), (0, 0, height)),
            rectangle("back", self.back, (-depth, 0, 0), (0, -width, 0), (0, 0, height)),
            rectangle("right", self.right, (0, -width, 0), (depth, 0, 0), (0, 0, height)),
            rectangle("top", self.top, (0, 0, height), (0, width, 0), (-depth, 0, 0)),
        )


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
