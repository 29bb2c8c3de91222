"""A map of space holds what its points have in common, survives its file, and is what the next run starts from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.exact.spatial_fixtures import spatial
from worlds.scenes.small_map import small_map

from semantic_slam import Configuration, Detection, Engine, Keyframe, MapPrior, ObjectPrior
from semantic_slam.errors import InputError
from semantic_slam.maps.as_prior import map_prior_of, saved_map_of_prior
from semantic_slam.maps.checks import check_map
from semantic_slam.maps.comparison import Comparison
from semantic_slam.maps.differences import difference
from semantic_slam.maps.frames import MapFrames
from semantic_slam.maps.from_run import saved_map_of_engine
from semantic_slam.maps.map_file import read_map, read_map_prior, with_id, write_map
from semantic_slam.maps.merging import merged
from semantic_slam.maps.saved_map import SavedMap
from semantic_slam.maps.telling import lines_of
from semantic_slam.maps.telling_changes import change_lines

PLACES = np.array([[2.0, 0.0, 0.5], [2.5, 1.0, -0.3], [3.0, -0.8, 0.2]])
START_SIGMA_M, RANGE_SIGMA_M, RAY_SIGMA = 0.8, 0.02, 0.005
ROUGHLY, EXACTLY = np.array([START_SIGMA_M] * 3 + [1e-4] * 3), np.full(6, 1e-4)
"""Standard deviations of the start."""


def started(sigmas: np.ndarray, known: MapPrior | None = None, **values: object) -> Engine:
    """An engine at the origin of map, of named points unless ``values`` say otherwise."""
    configuration = spatial(**{"association": "given", **values})
    return Engine(configuration, known, initial_pose=np.append(np.zeros(6), 1.0), initial_covariance=np.diag(sigmas**2))


def seen(number: int, robot: np.ndarray) -> Detection:
    """An object, exactly where it is, by a camera that looks along x and does not turn."""
    away = PLACES[number] - robot
    return Detection.along(
        away / np.linalg.norm(away),
        float(np.linalg.norm(away)),
        sigma_range_m=RANGE_SIGMA_M,
        ray_covariance=RAY_SIGMA**2 * np.eye(3),
        track_id=f"p{number}",
    )


@pytest.fixture(scope="module")
def known() -> SavedMap:
    """After a camera whose start is not known to better than most of a metre has seen three points from two places."""
    engine = started(ROUGHLY)
    for k in range(2):
        motion = np.array([0.5 * k, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        covariance = 1e-6 * np.eye(6)
        detections = [seen(number, motion[:3]) for number in range(len(PLACES))]
        frame = Keyframe.spatial(k, motion=motion, motion_covariance=covariance, detections=detections)
        belief = engine.process(frame)
    return saved_map_of_engine(engine, engine.pool, belief)


def test_what_points_have_in_common_is_the_start(known: SavedMap) -> None:
    """Differences of positions are known as well as the detections are; each position only as well as the start."""
    joint = known.hypotheses.covariances[0]
    apart = np.hstack([np.eye(3), -np.eye(3), np.zeros((3, 3))])
    assert np.sqrt(np.diagonal(joint)).min() > 0.9 * START_SIGMA_M
    assert np.sqrt(np.diagonal(apart @ joint @ apart.T)).max() < 2.0 * RANGE_SIGMA_M
    np.testing.assert_allclose(known.hypotheses.states[0], PLACES, atol=1e-3)


def test_a_map_survives_its_file(known: SavedMap, tmp_path: Path) -> None:
    write_map(tmp_path / "a.map", known)
    again = read_map(tmp_path / "a.map")
    assert again.state_space == "spatial"
    for part in ("objects", "hypotheses"):
        for name, values in vars(getattr(known, part)).items():
            np.testing.assert_array_equal(getattr(getattr(again, part), name), values)
    header, *rows = lines_of(again)[2:]
    assert "z [m]" in header and [float(row.split()[4]) for row in rows] == pytest.approx(PLACES[:, 2], abs=0.01)


def test_one_point_seen_again_places_the_others(known: SavedMap, tmp_path: Path) -> None:
    """A camera that knows where it is sees one point of the map; it then knows of all to some centimetres."""
    write_map(tmp_path / "a.map", known)
    frame, together = Keyframe.spatial(0, detections=[seen(0, np.zeros(3))]), read_map_prior(tmp_path / "a.map")
    beliefs = [started(EXACTLY, prior).process(frame) for prior in (together, replace(together, joint_covariance=None))]
    sigmas = [np.sqrt([np.trace(own[:3, :3]) for own in belief.object_covariances]) for belief in beliefs]
    assert sigmas[0].max() < 0.1 and sigmas[1][1:].min() > START_SIGMA_M


def test_a_map_of_another_space_is_refused_with_a_remedy(known: SavedMap) -> None:
    with pytest.raises(InputError, match=r"set\s+state_space"):
        Engine(Configuration.of(semantic_model={"kind": "none"}), map_prior_of(known))
    with pytest.raises(InputError, match="state_space"):
        started(EXACTLY, map_prior_of(small_map()))
    with pytest.raises(InputError, match="--marginals"):
        started(EXACTLY, map_prior_of(known), observation="range_bearing")


def room(places: np.ndarray, T: np.ndarray, first_id: int = 0) -> SavedMap:
    """A map of points (n, 3), each known to two centimetres, in a frame that is at ``T`` x, y, z, yaw in theirs."""
    frames = MapFrames.of("spatial")
    own = frames.moved(frames.inverse(T), places)
    points = (ObjectPrior.point(first_id + n, place, sigma_m=0.02) for n, place in enumerate(own))
    return with_id(saved_map_of_prior(MapPrior(tuple(points), state_space="spatial")))


ROOM = np.random.default_rng(3).uniform([-2.0, -2.0, 0.0], [2.0, 2.0, 1.8], (8, 3))
HERE, ELSEWHERE = np.zeros(4), np.array([1.2, -0.7, 0.4, 2.1])


@pytest.mark.long
def test_maps_of_space_are_aligned_and_tell_what_moved_left_and_came() -> None:
    """Frames are a shift and a turn about the vertical apart; one point is lifted, one gone, and one new."""
    later = ROOM.copy()
    later[0, 2] += 0.6
    later[1] = [0.3, 1.0, 2.4]
    found = difference(Comparison.of(room(ROOM, HERE), room(later, ELSEWHERE, 20)))
    assert not found.same_frame and found.alignment_probability > 0.9
    np.testing.assert_allclose(found.T_old_new, ELSEWHERE, atol=0.03)
    kinds = [own.kind for own in found.old]
    assert kinds[0] == "displaced" and found.old[0].distance_m == pytest.approx(0.6, abs=0.05)
    assert kinds[2:] == ["same"] * 6 and [own.new_id for own in found.old[2:]] == list(range(22, 28))
    (new,) = [own for own in found.new if own.probability > 0.5]
    assert new.object_id == 21 and found.old[1].new_id != 21
    np.testing.assert_allclose(new.position, later[1], atol=0.05)
    assert "z 0.4" in change_lines(found)[0]


@pytest.mark.long
def test_merged_maps_of_space_hold_every_point_once_in_the_first_one_s_frame() -> None:
    both = merged(room(ROOM[:6], HERE), room(ROOM[1:], ELSEWHERE, 20), "")
    assert both.state_space == "spatial" and len(both.objects) == len(ROOM)
    for place in ROOM:
        assert np.linalg.norm(both.objects.poses[:, :3] - place, axis=1).min() < 0.05
    check_map(both)


def test_maps_of_the_plane_and_of_space_are_not_compared(known: SavedMap) -> None:
    with pytest.raises(InputError, match="state_space"):
        Comparison.of(known, small_map())
