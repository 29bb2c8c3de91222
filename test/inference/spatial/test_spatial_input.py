"""What a run in space is given: what it refuses, each in one line with its remedy, and what it makes of the rest."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from worlds.exact.spatial_fixtures import spatial

from semantic_slam import Configuration, Detection, Engine, InputError, Keyframe, MapPrior, ObjectPrior
from semantic_slam.geometry import se3
from semantic_slam.inference.inputs.spatial_reader import SpatialReader
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.log_range import LogRange
from semantic_slam.inference.models.spatial.unmeasured_ranges import UnmeasuredRanges

ENUMERATED = {"classes": "enumerated"}
BODIES = {"association": "open", "observation": "range_bearing"}
KNOWN = MapPrior((ObjectPrior.point(0, (1.0, 1.0, 0.0), sigma_m=0.1),))


@pytest.mark.parametrize(
    ("setting", "remedy"),
    [
        ({"association": "open", "open_world": {"iterate_updates": False}}, "iterate_updates: true"),
        ({"association": "given", "open_world": {"iterate_updates": False}}, "iterate_updates: true"),
        ({"association": "open", "open_world": {"learn_region": True}}, "learn_region: false"),
        ({"association": "open", "open_world": {"direction_rad": 0.1}}, "direction_rad: 0"),
        ({"association": "open", "open_world": {"field_of_view_rad": 3.2}}, "below half a turn"),
        ({"association": "open", "perception": {"sigma_range_scale": 0.03}}, "sigma_range_scale: 0"),
        ({"semantic_model": {"kind": "parametric"}}, "observation: range_bearing"),
        ({"semantic_model": {"kind": "latent"}, "observation": "range_bearing"}, "association: open"),
        ({"semantic_model": {"kind": "latent"}, "association": "open"}, "observation: range_bearing"),
        ({**BODIES, "semantic_model": {"kind": "parametric"}, "open_world": ENUMERATED}, "classes: carried"),
        ({"moving": {"share": 0.1}}, "moving.share: 0"),
        ({"closed_world": {"unmapped_objects": 1}}, "unmapped_objects: 0"),
        ({"association": "enumerated", "revision": {"carried_probability": 1e-3}}, "carried_probability: 0"),
        ({"association": "open", "odometry": {"slip_share": 0.01}}, "slip_share: 0"),
        ({"closed_world": {"displaced_share": 0.1}}, "displaced_share: 0"),
        ({"initial_pose": {"mean": [0.0] * 3}}, "x, y, z, roll, pitch and yaw"),
    ],
)
def test_what_is_planar_alone_is_refused_in_one_line_with_its_remedy(setting: dict, remedy: str) -> None:
    start = {"mean": [0.0] * 6, "sigma": [0.1] * 6}
    values = {"observation": "points", "semantic_model": {"kind": "none"}, "initial_pose": start, **setting}
    with pytest.raises(InputError, match=remedy) as fault:
        Engine(Configuration.of(state_space="spatial", **values), KNOWN)
    assert "\n" not in str(fault.value) and "spatial" in str(fault.value)


def test_input_that_is_of_the_plane_is_refused_in_space() -> None:
    start = {"initial_pose": {"mean": [0.0] * 6, "sigma": [0.1] * 6}}
    flat = MapPrior((ObjectPrior.planar(0, 1.0, 2.0, sigma_m=0.1, sigma_rad=0.1),))
    with pytest.raises(InputError, match="no variance of their height"):
        Engine(spatial(**start), flat)
    with pytest.raises(InputError, match="x y z qx qy qz qw"):
        Engine(spatial(association="given"), initial_pose=(0.0, 0.0, 0.0), initial_covariance=np.eye(6))
    engine = Engine(spatial(association="given", **start))
    known = Detection(bearing_rad=0.1, range_m=1.0, covariance=np.eye(2), track_id="p")
    with pytest.raises(InputError, match="range, bearing, elevation"):
        engine.process(Keyframe.spatial(0, detections=[known]))


def read(seen: Detection) -> SpatialDetection:
    """A detection as the observation model gets it."""
    return SpatialReader(ConfiguredNoise()).step(Keyframe.spatial(0, detections=[seen])).detections[0]


def test_a_ray_errs_alike_whichever_way_it_points() -> None:
    """Straight down and up too, and beside that, where bearings mean little: each has a plane of its own across it."""
    random = np.random.default_rng(2)
    for direction in [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], *(random.normal(size=(20, 3)) * [1e-6, 1e-6, 1.0])]:
        found = read(Detection.along(direction, 2.0, sigma_range_m=0.1, ray_covariance=1e-4 * np.eye(3)))
        assert found.range_m == pytest.approx(2.0, rel=1e-15)
        np.testing.assert_allclose(found.ray, direction / np.linalg.norm(direction), atol=1e-15)
        np.testing.assert_allclose(found.covariance, np.diag([0.01, 1e-4, 1e-4]), atol=1e-15)
        assert found.is_round


def test_points_at_the_body_have_no_direction() -> None:
    with pytest.raises(InputError, match="leave out what has no direction"):
        Detection.in_space([0.0, 0.0, 1.0], T_body_sensor=[0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0])


def test_quaternions_of_three_digits_are_mended_and_others_refused() -> None:
    keyframe = Keyframe.spatial(0, motion=(0.1, 0.0, 0.0, 0.0, 0.0, 0.383, 0.924))
    assert np.linalg.norm(keyframe.odometry[3:]) == pytest.approx(1.0, abs=1e-15)
    with pytest.raises(InputError, match="quaternion of unit length"):
        Keyframe.spatial(0, motion=(0.1, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5))
    with pytest.raises(InputError, match="T_body_sensor"):
        Detection.along([1.0, 0.0, 0.0], 2.0, T_body_sensor=np.zeros(7))
    with pytest.raises(InputError, match="both sigma_range_m and ray_covariance"):
        Detection.along([1.0, 0.0, 0.0], 2.0, sigma_range_m=0.1)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (
            {"range_m": 2.0, "sigma_range_m": -0.1, "ray_covariance": 1e-4 * np.eye(3)},
            "give metres above 0",
        ),
        ({"sigma_range_m": 0.1}, "sigma_range_m is of no range; give range_m too"),
        (
            {"ray_covariance": 1e-3 * np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])},
            "3 x 3 finite numbers, symmetric",
        ),
        ({"ray_covariance": [[1.0], [1.0, 2.0]]}, "ray_covariance must be 3 x 3"),
        ({"range_m": "2"}, "a range of '2'; give lengths above 0"),
    ],
)
def test_a_ray_with_numbers_that_cannot_be_is_refused_with_the_remedy(wrong: dict, told: str) -> None:
    with pytest.raises(InputError, match=told):
        Detection.along((1.0, 0.0, 0.0), **wrong)


def test_a_start_in_space_without_a_rotation_is_refused() -> None:
    with pytest.raises(InputError, match="initial_pose: qx qy qz qw is no quaternion of unit length; normalise it"):
        Engine(spatial(association="given"), initial_pose=np.zeros(7), initial_covariance=np.eye(6))


def test_a_point_landmark_with_a_negative_sigma_is_refused() -> None:
    with pytest.raises(InputError, match="give a standard deviation of 0 or more"):
        ObjectPrior.point(0, (1.0, 1.0, 0.0), sigma_m=-0.1)


def test_motions_and_rays_without_covariances_err_as_configured() -> None:
    motion = se3.exp(np.array([0.0, 0.0, 0.5, 1.0, 0.0, 0.0]))
    seen = Detection.along([1.0, 2.0, 3.0], 2.0)
    step = SpatialReader(ConfiguredNoise()).step(Keyframe.spatial(0, motion=motion, detections=[seen]))
    variances = np.diagonal(step.motion.covariance)
    assert len(set(variances[:3])) == len(set(variances[3:])) == 1 and (variances > 0.0).all()
    assert step.detections[0].is_round


def test_the_cone_of_what_is_visible_is_about_the_axis_of_the_camera() -> None:
    """Of one whose mount is configured; else about the body's x."""
    start = {"mean": [0.0] * 6, "sigma": [0.1] * 6}
    for mounted, axis in (([], [1.0, 0.0, 0.0]), ([0.0] * 6 + [1.0], [0.0, 0.0, 1.0])):
        engine = Engine(
            spatial(initial_pose=start, visibility={"field_of_view_rad": 1.0}, perception={"extrinsics": mounted}),
            KNOWN,
        )
        x, away = np.array([[0.0] * 6 + [1.0]] * 2), np.array([axis, np.roll(axis, 1)])
        np.testing.assert_array_equal(engine.problem.model.log_visibility(x, away, soft=False), [0.0, -np.inf])


def test_a_ray_alone_errs_as_it_says_whichever_way_it_points() -> None:
    """From the camera, along the axes of the body; across it the covariance is that of the ray."""
    random = np.random.default_rng(3)
    root = random.normal(size=(3, 3))
    for direction in [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], *random.normal(size=(10, 3))]:
        ray = np.array(direction) / np.linalg.norm(direction)
        found = read(Detection.along(ray, ray_covariance=1e-4 * root @ root.T))
        assert not found.has_range
        np.testing.assert_allclose(found.ray, ray, atol=1.1e-4)  # a line of sight is straight up or down nowhere
        np.testing.assert_allclose(
            found.covariance[1:, 1:], 1e-4 * found.basis.T @ root @ root.T @ found.basis, rtol=1e-3, atol=1e-7
        )


def test_what_has_neither_range_nor_bearing_is_refused() -> None:
    keyframe = Keyframe.spatial(0, detections=[Detection(bearing_rad=0.0)])
    lost = replace(keyframe.measurements, bearings_rad=np.array([np.nan]))
    with pytest.raises(InputError, match="neither range nor bearing"):
        SpatialReader(ConfiguredNoise()).step(replace(keyframe, measurements=lost))
    with pytest.raises(InputError, match="width and height"):
        Detection.along([1.0, 0.0, 0.0], angular_size_rad=(0.1, -0.1))
    with pytest.raises(InputError, match=r"new_objects\.size_by_label"):
        UnmeasuredRanges.of(Configuration.of(new_objects={"size_by_label": ["cup"]}))


SIZED = {"size_by_label": ["Cup=0.1"], "sigma_log_size": 0.2, "sigma_log_view": 0.1}


@pytest.mark.parametrize("angle", [0.05, 0.2, 0.012, 1.0])
@pytest.mark.parametrize("accuracy", [0.95, 0.75])
def test_a_known_size_tells_how_far_a_box_is(angle: float, accuracy: float) -> None:
    """Within the region, by an integral: a cup is as large as cups are, but what is called so may have any size."""
    settings = Configuration.of(new_objects=SIZED, semantic_model={"label_accuracy": accuracy})
    found = UnmeasuredRanges.of(settings).of_detection("cup", angle * np.ones(2))
    log_range = np.linspace(np.log(0.3), np.log(5.0), 100_001)
    log_size = np.log(2.0 * np.tan(0.5 * angle)) + log_range
    of_cups, of_all = norm.pdf(log_size, np.log(0.1), np.hypot(0.2, 0.1)), norm.pdf(log_size, np.log(0.25), 1.01**0.5)
    density = accuracy * of_cups + (1.0 - accuracy) * of_all
    density /= density.sum()
    mean = density @ log_range
    np.testing.assert_allclose([found.mean, found.sigma**2], [mean, density @ (log_range - mean) ** 2], rtol=1e-3)


def test_a_box_whose_size_is_not_known_is_anywhere() -> None:
    """Or one that the image cuts, or that nothing inside the region looks like."""
    known = UnmeasuredRanges.of(Configuration.of(new_objects=SIZED))
    for label, angles in (("bowl", [0.05, 0.05]), ("cup", [np.nan, 0.05]), ("cup", [1e-4, 1e-4])):
        found = known.of_detection(label, np.array(angles))
        np.testing.assert_allclose([found.mean, found.sigma], [known.anywhere.mean, known.anywhere.sigma])


def test_what_is_known_of_a_range_has_the_moments_of_what_lies_within() -> None:
    low, high = np.log(0.3), np.log(5.0)
    grid = np.linspace(low, high, 200_001)
    for mean, sigma in ((0.2, 0.3), (1.5, 0.4), (0.5, 5.0)):
        density = np.exp(-0.5 * ((grid - mean) / sigma) ** 2)
        density /= density.sum()
        expected = density @ grid
        found = LogRange(mean, sigma).within(0.3, 5.0)
        assert found.mean == pytest.approx(expected, abs=1e-4)
        assert found.sigma == pytest.approx(np.sqrt(density @ (grid - expected) ** 2), abs=1e-4)
    even = LogRange(0.0, 1e4).within(0.3, 5.0)
    assert (even.mean, even.sigma) == pytest.approx((LogRange.between(0.3, 5.0).mean, (high - low) / 12**0.5), rel=1e-3)


def test_the_region_of_a_camera_is_refused_in_the_plane() -> None:
    with pytest.raises(InputError, match="region_by_camera: needs state_space: spatial"):
        Engine(Configuration.of(association="open", open_world={"region_by_camera": True}))
