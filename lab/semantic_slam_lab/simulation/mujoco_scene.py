"""MuJoCo scenes: furniture, alone or in a room, as XML and texture files in memory."""

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam_lab.simulation.catalogue import Model, model_named, picture_named
from semantic_slam_lab.simulation.surface import Surface

WALL_HEIGHT_M = 3.0
METRES_PER_TILE_PICTURE = 1.2


@dataclass(frozen=True)
class PlacedObject:
    """One object standing on the floor."""

    object_id: int  # instance id, > 0
    name: str  # instance, e.g. chest_1
    class_name: str  # its model
    x_m: float
    y_m: float
    yaw_rad: float  # direction of its front

    @property
    def model(self) -> Model:
        return model_named(self.class_name)

    @property
    def pose(self) -> NDArray[np.float64]:
        """(7,) pose of the object's frame in map."""
        half = self.yaw_rad / 2.0
        return np.array([self.x_m, self.y_m, self.model.size[2] / 2.0, 0.0, 0.0, np.sin(half), np.cos(half)])


@dataclass(frozen=True)
class Room:
    """Walls of a rectangular room, map frame, metres."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float


def scene_xml(objects: Sequence[PlacedObject], room: Room | None) -> tuple[str, dict[str, bytes]]:
    """XML and texture files of a scene; body ``i + 1`` is ``objects[i]``. The only camera is number 0."""
    models = {placed.class_name: placed.model for placed in objects}
    pictures = {surface.picture for model in models.values() for surface in model.surfaces()} | (
        {"floor", "wall"} if room else set()
    )
    assets = [_picture_xml(name, room) for name in sorted(pictures)]
    assets += [_mesh_xml(model, surface) for model in models.values() for surface in model.surfaces()]
    world = [_body_xml(placed) for placed in objects] + ([_room_xml(room)] if room else [])
    xml = f"""<mujoco>
  <statistic center="0 0 0" extent="10"/>
  <visual>
    <quality offsamples="0" shadowsize="1024"/>
    <map znear="0.01" zfar="3"/>
    <headlight ambient="0.5 0.5 0.5" diffuse="0.32 0.32 0.32" specular="0 0 0"/>
  </visual>
  <default><geom contype="0" conaffinity="0"/></default>
  <asset>
    <texture type="skybox" builtin="flat" rgb1="0.82 0.83 0.84" rgb2="0.82 0.83 0.84" width="8" height="8"/>
    {"".join(assets)}
  </asset>
  <worldbody>
    <light pos="0 0 6" dir="0.15 0.1 -1" directional="true" diffuse="0.28 0.28 0.28" specular="0 0 0"/>
    <camera name="camera" pos="0 0 1"/>
    {"".join(world)}
  </worldbody>
</mujoco>"""
    return xml, {_file_name(name): _png(name) for name in pictures}


def _png(name: str) -> bytes:
    return cv2.imencode(".png", cv2.cvtColor(picture_named(name), cv2.COLOR_RGB2BGR))[1].tobytes()


def _picture_xml(name: str, room: Room | None) -> str:
    repeat = ""
    if room and name == "floor":
        repeat = _repeat(room.x_max - room.x_min, room.y_max - room.y_min)
    if room and name == "wall":
        repeat = 'texrepeat="6 1"'
    texture = f'<texture type="2d" name="{name}" file="{_file_name(name)}"/>'
    return texture + f'<material name="{name}" texture="{name}" specular="0" {repeat}/>'


def _repeat(width_m: float, height_m: float) -> str:
    return f'texrepeat="{width_m / METRES_PER_TILE_PICTURE:.3f} {height_m / METRES_PER_TILE_PICTURE:.3f}"'


def _file_name(picture: str) -> str:
    return f"{picture.replace('/', '-')}.png"


def _mesh_xml(model: Model, surface: Surface) -> str:
    """A mesh without volume is a shell."""
    vertices = " ".join(f"{value:.6f}" for value in surface.vertices.ravel())
    texture = " ".join(f"{value:.6g}" for value in surface.texture.ravel())
    triangles = " ".join(str(index) for index in surface.triangles.ravel())
    shape = f'vertex="{vertices}" texcoord="{texture}" face="{triangles}"'
    return f'<mesh name={quoteattr(f"{model.name}_{surface.name}")} inertia="shell" {shape}/>'


def _body_xml(placed: PlacedObject) -> str:
    geoms = "".join(
        f'<geom type="mesh" mesh="{placed.class_name}_{surface.name}" material="{surface.picture}"/>'
        for surface in placed.model.surfaces()
    )
    height = placed.model.size[2] / 2.0
    return (
        f'<body name={quoteattr(placed.name)} pos="{placed.x_m:.6f} {placed.y_m:.6f} {height:.6f}"'
        f' euler="0 0 {np.rad2deg(placed.yaw_rad):.6f}">{geoms}</body>'
    )


def _room_xml(room: Room) -> str:
    """Floor and four walls as planes that face inwards; a ceiling would keep the light out."""
    x, y = (room.x_min + room.x_max) / 2.0, (room.y_min + room.y_max) / 2.0
    width, depth, height = (room.x_max - room.x_min) / 2.0, (room.y_max - room.y_min) / 2.0, WALL_HEIGHT_M / 2.0
    walls = (
        (f"{room.x_min} {y} {height}", "0 -1 0 0 0 1", depth),
        (f"{room.x_max} {y} {height}", "0 1 0 0 0 1", depth),
        (f"{x} {room.y_min} {height}", "1 0 0 0 0 1", width),
        (f"{x} {room.y_max} {height}", "-1 0 0 0 0 1", width),
    )
    planes = "".join(
        f'<geom type="plane" pos="{position}" xyaxes="{axes}" size="{half} {height} 1" material="wall"/>'
        for position, axes, half in walls
    )
    return f'<geom type="plane" pos="{x} {y} 0" size="{width} {depth} 1" material="floor"/>' + planes
