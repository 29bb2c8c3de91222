"""What a run in space is given: what it refuses, each in one line with its remedy, and what it makes of the rest."""

import numpy as np
import pytest
from worlds.spatial_fixtures import spatial

from semantic_slam import Configuration, Detection, Engine, InputError, Keyframe, MapPrior, ObjectPrior
from semantic_slam.geometry import se3
from semantic_slam.inference.inputs.spatial_reader import SpatialReader
from semantic_slam.inference.models.configured_noise import ConfiguredNoise
from semantic_slam.inference.models.spatial.detection import SpatialDetection

KNOWN = MapPrior((ObjectPrior.point(0, (1.0, 1.0, 0.0), sigma_m=0.1),))


@pytest.mark.parametrize(
    ("setting", "remedy"),
    [
        ({"association": "open", "open_world": {"iterate_updates": False}}, "iterate_updates: true"),
        ({"association": "given", "open_world": {"iterate_updates": False}}, "iterate_updates: true"),
        ({"association": "open", "revision": {"every_keyframes": 5}}, "revision.every_keyframes: 0"),
        ({"association": "open", "open_world": {"learn_region": True}}, "learn_region: false"),
        ({"association": "open", "open_world": {"direction_rad": 0.1}}, "direction_rad: 0"),
        ({"association": "open", "open_world": {"field_of_view_rad": 3.2}}, "below half a turn"),
        ({"association": "open", "perception": {"sigma_range_scale": 0.03}}, "sigma_range_scale: 0"),
        ({"semantic_model": {"kind": "parametric"}}, "observation: range_bearing"),
        ({"semantic_model": {"kind": "latent"}, "observation": "range_bearing"}, "one of viewpoints"),
        ({"association": "open", "observation": "range_bearing"}, "observation: points"),
        ({"moving": {"share": 0.1}}, "moving.share: 0"),
        ({"closed_world": {"unmapped_objects": 1}}, "unmapped_objects: 0"),
        ({"closed_world": {"displaced_share": 0.1}}, "displaced_share: 0"),
        ({"history": {"horizon_keyframes": 50}}, "horizon_keyframes: 0"),
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
