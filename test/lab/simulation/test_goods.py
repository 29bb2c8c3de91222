"""Goods: what an instance looks like follows from its name, and its sides lie where the object frame says."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.simulation.catalogue import class_named, model_named, picture_named
from semantic_slam_lab.simulation.goods import CLASSES, goods_class, goods_names
from semantic_slam_lab.simulation.layout import draw_layout
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject, scene_xml
from semantic_slam_lab.simulation.renderer import Renderer, camera_model
from semantic_slam_lab.simulation.textures import SIZE
from semantic_slam_lab.simulation.turntable import CAMERAS, table_from_camera
from worlds.processes.commands import call


def test_names_go_through_the_classes_in_turn() -> None:
    names = goods_names(2 * len(CLASSES))
    assert len(set(names)) == len(names)
    assert [goods_class(name) for name in names[: len(CLASSES)]] == sorted(CLASSES)


@pytest.mark.parametrize("name", ["drum", "drum_", "sofa_01", "drum_01/front"])
def test_unknown_names_are_refused(name: str) -> None:
    with pytest.raises(KeyError):
        model_named(name)


@pytest.mark.parametrize("class_name", sorted(CLASSES))
def test_instances_differ_and_are_the_same_every_time(class_name: str) -> None:
    first, second = model_named(f"{class_name}_01"), model_named(f"{class_name}_02")
    assert first.size != second.size
    for own, other in zip(first.surfaces(), second.surfaces(), strict=True):
        picture = picture_named(own.picture)
        np.testing.assert_array_equal(picture, picture_named(own.picture))
        assert np.abs(picture.astype(float) - picture_named(other.picture)).mean() > 1.0


@pytest.mark.parametrize("class_name", sorted(CLASSES))
def test_surfaces_face_outwards_inside_the_stated_size(class_name: str) -> None:
    model = model_named(f"{class_name}_01")
    for surface in model.surfaces():
        a, b, c = (surface.vertices[surface.triangles[:, corner]] for corner in range(3))
        normals, middles = np.cross(b - a, c - a), (a + b + c) / 3.0
        real = np.linalg.norm(normals, axis=1) > 1e-12
        assert ((normals * middles).sum(axis=1)[real] > 0.0).all()
        assert (np.abs(surface.vertices) <= np.array(model.size) / 2.0 + 1e-9).all()
        assert ((surface.texture >= 0.0) & (surface.texture <= 1.0)).all()


@pytest.mark.render
@pytest.mark.parametrize("name", ["drum_01", "engine_01"])
def test_sides_appear_at_their_azimuth(name: str) -> None:
    """The middle of a view from 0, 90, 180, 270 degrees is the picture of front, left, back and right, upright."""
    model = model_named(name)
    xml, assets = scene_xml([PlacedObject(1, name, name, 0.0, 0.0, 0.0)], room=None)
    world_from_table = np.eye(4)
    world_from_table[2, 3] = model.size[2] / 2.0
    with Renderer(xml, assets, camera_model(160, 120, np.deg2rad(52.0))) as renderer:
        views = [
            renderer.render(world_from_table @ table_from_camera(CAMERAS[0], np.deg2rad(angle)))
            for angle in (0, 90, 180, 270)
        ]
    seen = np.array([_middle(view.image, view.body_ids == 1) for view in views])
    drawn = np.array([_drawn_side(name, side) for side in ("front", "left", "back", "right")])
    likeness = np.corrcoef(np.concatenate([seen.reshape(4, -1), drawn.reshape(4, -1)]))[:4, 4:]
    assert (likeness.argmax(axis=1) == np.arange(4)).all()


def _middle(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(12, 12, 3) of the inner part of the object."""
    import cv2

    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    window = image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return _inner(cv2.resize(window, (48, 48), interpolation=cv2.INTER_AREA))


def _drawn_side(name: str, side: str) -> np.ndarray:
    """The same of the picture itself; a wrap shows half of itself from each side, but for the foreshortened rim."""
    import cv2

    if name.startswith("drum"):
        wrap = np.roll(picture_named(f"{name}/wrap"), SIZE // 2, axis=1)  # back, right, front, left
        at = ("back", "right", "front", "left").index(side)
        picture = wrap[:, at * SIZE : (at + 1) * SIZE]
    else:
        picture = picture_named(f"{name}/{side}")
    return _inner(cv2.resize(picture, (48, 48), interpolation=cv2.INTER_AREA))


def _inner(picture: np.ndarray) -> np.ndarray:
    return picture[12:36:2, 12:36:2].astype(float)


def test_rooms_hold_two_different_instances_of_four_classes() -> None:
    placed = draw_layout(2, goods=48)
    assert len({item.class_name for item in placed}) == len(placed) == 8
    assert sorted(Counter(class_named(item.class_name) for item in placed).values()) == [2, 2, 2, 2]


@pytest.mark.slow
@pytest.mark.render
def test_command_writes_goods_and_their_classes(tmp_path: Path) -> None:
    words = ("--turntable", "--goods", 2, "--step-deg", 180, "--out", tmp_path)
    assert call(tmp_path, "semantic_slam_lab.commands.make_scene", *words).returncode == 0
    assert json.loads((tmp_path / "classes.json").read_text()) == {"barrel_01": "barrel", "bin_01": "bin"}
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_dir()) == ["barrel_01", "bin_01"]
