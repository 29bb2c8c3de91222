"""The simulator: layout and tour without rendering; rendered rooms and turntables where EGL or OSMesa works."""

from collections import Counter
from functools import cache
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from semantic_slam_lab.simulation import renderer
from semantic_slam_lab.simulation.annotation import annotate, corners, difficulty
from semantic_slam_lab.simulation.furniture import MODELS
from semantic_slam_lab.simulation.layout import draw_layout, frames_xy, grid
from semantic_slam_lab.simulation.move_graph import moves
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject
from semantic_slam_lab.simulation.renderer import camera_model
from semantic_slam_lab.simulation.scene import SceneSettings, camera_poses, make_scene
from semantic_slam_lab.simulation.textures import PICTURES, draw
from semantic_slam_lab.simulation.tour import VIEWS_PER_POSITION, drive, ring, sees, tour
from semantic_slam_lab.simulation.turntable import CAMERAS, TurntableSettings, write_turntables

from semantic_slam.datasets import bigbird
from semantic_slam.datasets.avd import avd_import
from semantic_slam.datasets.avd import scene as avd
from semantic_slam.datasets.avd.objects import true_objects
from semantic_slam.datasets.avd.path import read_path
from semantic_slam.errors import InputError

SEEDS = range(4)
layout = cache(draw_layout)


@pytest.mark.parametrize("seed", SEEDS)
def test_layout_is_an_almost_regular_grid_of_repeated_classes(seed: int) -> None:
    objects = layout(seed)
    assert objects == draw_layout(seed)
    counts = Counter(placed.class_name for placed in objects)
    assert set(counts) == set(MODELS)
    assert sum(count >= 2 for count in counts.values()) >= 2
    places = np.array([[placed.x_m, placed.y_m] for placed in objects])
    distances = np.linalg.norm(places[:, None] - grid(), axis=-1)
    assert sorted(distances.argmin(axis=1)) == list(range(len(objects)))  # one object per place
    assert distances.min(axis=1).max() < 0.1


def test_seeds_differ() -> None:
    assert len({tuple(placed.class_name for placed in layout(seed)) for seed in SEEDS}) > 1
    headings = np.array([[placed.yaw_rad for placed in layout(seed)] for seed in SEEDS])
    assert np.abs(np.diff(headings, axis=0)).max(axis=1).min() > 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_tour_shows_every_object_often_and_from_its_front(seed: int) -> None:
    frames, objects = tour(seed), layout(seed)
    places = np.array([[placed.x_m, placed.y_m] for placed in objects])
    visible = np.array([sees(frame, places) for frame in frames])
    offsets = frames_xy(frames)[:, None] - places
    azimuths = np.arctan2(offsets[..., 1], offsets[..., 0]) - [placed.yaw_rad for placed in objects]
    front = np.cos(azimuths) > np.cos(0.9)
    assert 60 <= len(frames) <= 90
    assert visible.sum(axis=0).min() >= 6
    assert (visible & front).sum(axis=0).min() >= 3
    assert (visible.sum(axis=1) >= 1).mean() > 0.9


def test_drive_keeps_to_the_move_graph() -> None:
    names = [str(index) for index in range(len(ring()) * VIEWS_PER_POSITION)]
    links = moves(names, ring())
    stops = [frame.image for frame in drive(0)]
    for before, after in pairwise(stops):
        assert names[after] in links[before].values()


def test_pictures_depend_on_their_name_alone() -> None:
    first = {name: draw(name) for name in PICTURES}
    for name in reversed(PICTURES):
        np.testing.assert_array_equal(draw(name), first[name])


def test_classes_share_backs_and_differ_in_front() -> None:
    fronts = [model.front for model in MODELS.values()]
    backs = Counter(model.back for model in MODELS.values())
    assert len(set(fronts)) == len(fronts)
    assert min(backs.values()) >= 2


def test_difficulty_grows_with_what_is_hidden() -> None:
    assert [difficulty(fraction, 100) for fraction in (1.0, 0.8, 0.6, 0.3, 0.1)] == [1, 2, 3, 4, 5]
    assert difficulty(1.0, 20) == 2


def test_annotation_of_a_silhouette_is_its_bounding_box() -> None:
    """The convex hull of the projected corners, filled, is what a renderer would show of a box alone."""
    placed, camera = PlacedObject(7, "desk_1", "desk", 2.0, 0.2, 0.5), camera_model(320, 240, 1.4)
    pose = camera_poses(np.zeros((1, 2)), 0)[0]
    points = (corners(placed) - pose[:3, 3]) @ pose[:3, :3]
    pixels = points[:, :2] / points[:, 2:] * camera.fx + [camera.cx, camera.cy]
    mask = cv2.fillConvexPoly(np.zeros((240, 320), np.int32), cv2.convexHull(pixels.round().astype(np.int32)), 1)
    (found,) = annotate(mask, [placed], pose, camera)
    np.testing.assert_allclose(found.box[:2], pixels.min(axis=0), atol=1.0)
    np.testing.assert_allclose(found.box[2:], pixels.max(axis=0) + 1.0, atol=1.0)
    assert (found.object_id, found.difficulty) == (7, 1)
    mask[:, : round(pixels[:, 0].mean())] = 0  # half hidden
    assert annotate(mask, [placed], pose, camera)[0].difficulty >= 3


def test_seed_beyond_three_digits_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--seed 1000"):
        make_scene(tmp_path, 1000)


def test_machine_without_rendering_gets_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> None:
        raise OSError(name)

    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(renderer.ctypes, "CDLL", refuse)
    with pytest.raises(InputError, match="install libegl1"):
        renderer.choose_library()


@pytest.fixture(scope="module")
def room_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_scene(tmp_path_factory.mktemp("avd"), 0, SceneSettings(width=360, height=270, tour_only=True))


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.render
def test_rendered_poses_and_objects_agree(room_folder: Path) -> None:
    """Centres of fully visible objects project into their boxes, and the depth there ends at their surface."""
    scene = avd.read_scene(room_folder)
    objects = {known.object_id: known for known in true_objects(scene)}
    offsets = []
    for name, image in scene.images.items():
        depth = scene.depth_m(name)
        for row in np.flatnonzero((image.difficulties == 1) & ~np.bool_(image.rebuilt)):
            centre = objects[int(image.instance_ids[row])].pose[:3]
            x, y, z = image.T_map_camera[:3, :3].T @ (centre - image.T_map_camera[:3, 3])
            u, v = scene.camera.fx * x / z + scene.camera.cx, scene.camera.fy * y / z + scene.camera.cy
            x_min, y_min, x_max, y_max = image.boxes[row]
            assert x_min < u < x_max
            assert y_min < v < y_max
            offsets.append(z - float(depth[int(v), int(u)]))
    assert len(offsets) > 50
    least, most = 0.5 * min(MODELS["crate"].size), 0.5 * np.linalg.norm(MODELS["cabinet"].size)
    shares = np.mean((np.array(offsets) > least - 0.05) & (np.array(offsets) < most + 0.05))
    assert shares > 0.95  # another object may hide the very middle


@pytest.mark.slow
@pytest.mark.render
def test_rendered_floor_is_at_zero(room_folder: Path) -> None:
    assert avd.floor_height(avd.read_scene(room_folder)) == pytest.approx(0.0, abs=0.01)


@pytest.mark.slow
@pytest.mark.render
def test_rendered_scene_has_rebuilt_frames_and_true_poses(room_folder: Path) -> None:
    scene = avd.read_scene(room_folder)
    poses = camera_poses(ring(), 0)
    assert 0 < len(scene.rebuilt) < 0.15 * len(scene.images)
    for name, image in scene.images.items():
        true = poses[int(name[5:11])]
        tolerance = 0.06 if image.rebuilt else 1e-9
        np.testing.assert_allclose(image.T_map_camera, true, atol=tolerance)


@pytest.mark.slow
@pytest.mark.render
def test_rendered_room_becomes_a_bag_of_the_promised_kind(room_folder: Path, tmp_path: Path) -> None:
    result = avd_import.import_avd(room_folder, tmp_path / "bag", seed=2)
    assert result.keyframes >= 60
    assert not result.triangulated
    assert result.dead_reckoning_ate_m > 0.3
    assert result.rebuilt
    stops = read_path(avd.read_scene(room_folder), room_folder / "tour.txt")
    assert result.odometry_samples == len(stops) > result.keyframes


@pytest.mark.slow
@pytest.mark.render
def test_scene_folder_is_not_overwritten(room_folder: Path) -> None:
    with pytest.raises(InputError, match="exists already"):
        make_scene(room_folder.parent, 0)


@pytest.fixture(scope="module")
def turntables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("bigbird")
    write_turntables(root, tuple(MODELS), TurntableSettings(step_deg=90, width=160, height=120))
    return root


@pytest.mark.slow
@pytest.mark.render
def test_turntables_are_read_by_the_loader_of_the_real_format(turntables: Path) -> None:
    folders = bigbird.object_folders(turntables)
    assert [folder.name for folder in folders] == sorted(MODELS)
    for view in bigbird.turntable_views(folders[0]):
        azimuth, _, distance = view.viewpoint
        assert np.exp(1j * azimuth) == pytest.approx(np.exp(1j * np.deg2rad(view.angle_deg)))
        nearest, corner = np.nanmin(view.depth_m), 0.5 * np.linalg.norm(MODELS[view.object_name].size)
        assert distance - corner - 0.01 < nearest < distance
        assert np.nanmax(view.depth_m) < distance + corner
        assert view.box[0] > 0
        assert view.box[2] < view.image.shape[1]  # wholly in the picture


@pytest.mark.slow
@pytest.mark.render
def test_faces_appear_at_their_azimuth(turntables: Path) -> None:
    """Colour: the chest's dark front at 0 degrees, its left side with the iron band at 90, plain boards elsewhere."""
    views = {view.angle_deg: view for view in bigbird.turntable_views(turntables / "chest", (CAMERAS[0].name,))}
    brightness = {angle: float(view.image[view.mask].mean()) for angle, view in views.items()}
    assert brightness[0] < brightness[90] < min(brightness[180], brightness[270])


@pytest.mark.slow
@pytest.mark.render
def test_shared_backs_look_alike_and_fronts_do_not(turntables: Path) -> None:
    wooden = {
        name: {view.angle_deg: view for view in bigbird.turntable_views(turntables / name, ("NP2",))}
        for name in ("crate", "chest", "desk")
    }
    for name in ("chest", "desk"):
        back = wooden["crate"][180].image.astype(float) - wooden[name][180].image
        front = wooden["crate"][0].image.astype(float) - wooden[name][0].image
        assert np.abs(back).mean() < 1.0
        assert np.abs(front).mean() > 4.0
