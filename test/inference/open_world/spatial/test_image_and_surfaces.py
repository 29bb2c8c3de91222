"""The image of a camera as the region in which misses count, and the surfaces of its depth, which hide objects."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, HybridBelief, Keyframe
from semantic_slam.inference.models.spatial.camera import Camera
from semantic_slam.inference.open_world.rings import rings
from semantic_slam.inference.open_world.spatial.free_ranges import BEHIND_M
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.perception.camera_sight import sight_of
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.image_sight import ImageSight

CAMERA = CameraModel(640, 480, 500.0, 400.0, 250.0, 280.0)
TYPED = SpatialRegion(
    min_range_m=0.5, max_range_m=4.0, half_width_rad=0.2, half_height_rad=0.2, occluder_radius_m=0.05, by_camera=True
)


def image_region(sight: ImageSight) -> SpatialRegion:
    return TYPED.reaching(Camera(sight=sight))


def drawn(count: int = 400_000) -> np.ndarray:
    """Points of the optical frame, even in a box of 8 x 8 x 4.5 m about the region."""
    return np.random.default_rng(0).uniform([-4.0, -4.0, 0.0], [4.0, 4.0, 4.5], (count, 3))


def in_image(points: np.ndarray) -> np.ndarray:
    """(N,) whether the camera's image shows points, by its projection alone."""
    with np.errstate(divide="ignore"):
        u = CAMERA.fx * points[:, 0] / points[:, 2] + CAMERA.cx
        v = CAMERA.fy * points[:, 1] / points[:, 2] + CAMERA.cy
    return (points[:, 2] > 0.0) & (u >= 0.0) & (u <= CAMERA.width) & (v >= 0.0) & (v <= CAMERA.height)


def test_the_region_of_a_camera_is_what_projects_into_its_image() -> None:
    """Its principal point is far from the middle of the image."""
    region, points = image_region(sight_of(CAMERA)), drawn()
    distance = np.linalg.norm(points, axis=1)
    inside = in_image(points) & (distance > 0.5) & (distance < 4.0)
    np.testing.assert_array_equal(region.holds(points), inside)
    assert region.volume_m3 == pytest.approx(288.0 * inside.mean(), rel=0.01)
    everywhere, shares = region.all_over(rings(0.5, 4.0, (np.inf,), 3))
    assert in_image(everywhere).all()
    np.testing.assert_allclose(shares @ everywhere, points[inside].mean(axis=0), atol=0.05)


@pytest.mark.parametrize("centre", [[0.8, 0.0, 2.0], [-1.0, 0.1, 2.0], [0.3, 0.95, 2.0], [0.1, -1.4, 2.0]])
def test_an_uncertain_object_at_an_edge_of_the_image_is_inside_as_often_as_its_samples(centre: list[float]) -> None:
    spread = np.diag([0.02, 0.01, 0.015])
    samples = np.random.default_rng(1).multivariate_normal(centre, spread, 100_000)
    assert image_region(sight_of(CAMERA)).contains(np.array(centre), spread) == pytest.approx(
        in_image(samples).mean(), abs=0.03
    )


def test_without_camera_info_or_if_it_is_not_asked_for_the_region_is_as_typed() -> None:
    for region, sight in ((TYPED, None), (replace(TYPED, by_camera=False), sight_of(CAMERA))):
        found = region.reaching(Camera(sight=sight))
        assert (found.half_width_rad, found.half_height_rad, found.middle_rad) == (0.2, 0.2, (0.0, 0.0))


def half_a_wall(depth_m: float) -> ImageSight:
    """A wall from the optical axis to the right; to the left of it all is far."""
    depth = np.full((CAMERA.height, CAMERA.width), 9.0, dtype=np.float32)
    depth[:, 250:] = depth_m
    return sight_of(CAMERA, depth)


@pytest.mark.parametrize("place", [[0.1, 0.0, 2.8], [-0.05, 0.2, 2.6], [0.6, 0.0, 1.9], [0.3, -0.2, 3.4]])
def test_an_uncertain_object_is_hidden_as_often_as_its_samples_are_behind_the_wall(place: list[float]) -> None:
    spread = np.array([[0.02, 0.006, 0.004], [0.006, 0.01, 0.0], [0.004, 0.0, 0.04]])
    samples = np.random.default_rng(2).multivariate_normal(place, spread, 200_000)
    ray = samples / samples[:, 2:]
    edge = sight_of(CAMERA).edges_rad[0]
    cell = np.tan(edge[0]) + np.ptp(np.tan(edge)) / 24.0 * np.ceil(-np.tan(edge[0]) / (np.ptp(np.tan(edge)) / 24.0))
    hidden = (ray[:, 0] > cell) & (np.linalg.norm(samples, axis=1) > 2.0 * np.linalg.norm(ray, axis=1) + BEHIND_M)
    found = image_region(half_a_wall(2.0)).seen_before_surfaces(np.array(place), spread)
    assert found == pytest.approx(1.0 - hidden.mean(), abs=0.06)


def test_surfaces_hide_nothing_where_nothing_shall() -> None:
    region = replace(image_region(half_a_wall(1.0)), occluder_radius_m=0.0)
    assert region.seen_before_surfaces(np.array([0.5, 0.0, 3.0]), 1e-4 * np.eye(3)) == 1.0


PLACES = {"before the wall": [1.2, 0.0, 0.0], "behind it": [3.0, 0.3, 0.1], "beside it": [3.0, 0.9, 0.0]}


def after_misses(sight: ImageSight | None, **world: Any) -> tuple[Engine, HybridBelief]:
    """Objects that are seen twice, before there is a wall, and then missed by a camera at rest that sees ``sight``."""
    rates = {"detection_probability": 0.8, "clutter_per_frame": 0.3, "birth_density": 0.1}
    region = {"min_range_m": 0.3, "max_range_m": 5.0, "occluder_radius_m": 0.05}
    configuration = Configuration.of(
        state_space="spatial",
        observation="points",
        association="open",
        semantic_model={"kind": "none"},
        open_world={**rates, **region, **world},
    )
    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    engine = Engine(configuration, initial_pose=start, initial_covariance=1e-6 * np.eye(6))
    for k in range(7):
        seen = [Detection.in_space(place, covariance=1e-3 * np.eye(3)) for place in PLACES.values()] if k < 2 else []
        keyframe = Keyframe.spatial(k, detections=seen, motion_covariance=1e-8 * np.eye(6))
        if sight is not None and k >= 2:
            told = {"image_edges_rad": sight.edges_rad, "free_ranges_m": sight.free_ranges_m}
            keyframe = replace(keyframe, measurements=replace(keyframe.measurements, **told))
        belief = engine.process(keyframe)
    return engine, belief


def wall_ahead() -> ImageSight:
    """Two metres ahead, but for the left part of the image, which sees past it."""
    depth = np.full((480, 640), 2.0, dtype=np.float32)
    depth[:, :220] = 9.0
    return sight_of(CameraModel(640, 480, 400.0, 400.0, 320.0, 240.0), depth)


def test_an_object_behind_a_wall_keeps_its_existence_and_one_before_or_beside_it_does_not() -> None:
    """Each miss of an object in view leaves 1 - p_d of its odds; of one that is hidden, all of them."""
    (_, open_view), (_, walled) = after_misses(None), after_misses(wall_ahead())
    np.testing.assert_array_equal(open_view.object_ids, walled.object_ids)
    odds = [own.existence / (1.0 - own.existence) for own in (open_view, walled)]
    np.testing.assert_allclose(odds[1] / odds[0], [1.0, 0.2**-5, 1.0], rtol=1e-3)


def test_fewer_first_detections_are_expected_where_a_wall_hides_the_region() -> None:
    """A wall leaves the part of the region's volume before it, and as far behind it as an object's centre may be."""
    region = SpatialRegion.of(after_misses(None)[0].problem.open_world)
    depth = np.full((480, 640), 2.0, dtype=np.float32)
    camera = CameraModel(640, 480, 200.0, 200.0, 320.0, 240.0)
    looking = region.reaching(Camera(sight=sight_of(camera, depth)))
    everywhere, shares = looking.all_over(rings(region.min_range_m, region.max_range_m, (np.inf,), 3))
    found = shares @ looking.seen_before_surfaces(everywhere, np.zeros((len(everywhere), 3, 3)))
    points = drawn()
    inside = points[region.holds(points)]
    free = np.linalg.norm(inside, axis=1) < 2.0 * np.linalg.norm(inside / inside[:, 2:], axis=1) + BEHIND_M
    assert found == pytest.approx(free.mean(), abs=0.08)


def test_misses_count_in_the_image_and_not_beyond_it() -> None:
    """A typed region is wider than the image of a narrow camera, which shows the objects ahead alone."""
    narrow = sight_of(CameraModel(640, 480, 2000.0, 2000.0, 320.0, 240.0))
    (_, typed), (_, by_image) = after_misses(narrow), after_misses(narrow, region_by_camera=True)
    odds = [own.existence / (1.0 - own.existence) for own in (typed, by_image)]
    np.testing.assert_allclose(odds[1] / odds[0], [1.0, 1.0, 0.2**-5], rtol=1e-2)
