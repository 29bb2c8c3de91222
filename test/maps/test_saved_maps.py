"""A map holds what its objects have in common, survives its file, and is what the next run starts from."""

import json
import math
import os
from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file
from worlds.drives import moving_world
from worlds.scenes.small_map import GIVEN, LOOSE, PLACES, keyframes, run_to_its_end, small_map

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.building import make_run_configuration, problem_of, start_of_run
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.states.lineage import MOVES
from semantic_slam.inference.world.map_prior import parse_map_prior
from semantic_slam.inference.world.roots import closed_root
from semantic_slam.maps.as_prior import map_prior_of, saved_map_of_prior
from semantic_slam.maps.from_belief import saved_map_of_belief
from semantic_slam.maps.from_run import saved_map_of_engine
from semantic_slam.maps.map_file import FORMAT, packed, read_map, read_map_prior, with_id, write_map
from semantic_slam.maps.merging import merged
from semantic_slam.maps.saved_map import Provenance, SavedMap
from semantic_slam.maps.telling import lines_of


@pytest.fixture(scope="module")
def known() -> SavedMap:
    return small_map()


def same_arrays(one: SavedMap, other: SavedMap) -> None:
    for part in ("objects", "hypotheses", "looks"):
        for name, values in vars(getattr(one, part)).items():
            np.testing.assert_array_equal(getattr(getattr(other, part), name), values)


def test_joint_covariance_is_the_marginal_of_the_whole_graph() -> None:
    engine, belief = run_to_its_end()
    assert isinstance(engine.pool, InProcessPool)
    saved = saved_map_of_engine(engine, engine.pool, belief)
    isam = engine.pool.component(int(belief.hypothesis_ids[0])).smoother.isam
    whole = gtsam.Marginals(isam.getFactorsUnsafe(), isam.calculateEstimate())
    keys = [object_key(n) for n in range(len(PLACES))]
    joint = np.block([[whole.jointMarginalCovariance([a, b]).at(a, b) for b in keys] for a in keys])
    turns = [gtsam.Pose2(*state).rotation().matrix() for state in saved.hypotheses.states[0]]
    slopes = np.zeros((12, 12))
    for row, turn in enumerate(turns):
        slopes[3 * row : 3 * row + 2, 3 * row : 3 * row + 2], slopes[3 * row + 2, 3 * row + 2] = turn, 1.0
    np.testing.assert_allclose(saved.hypotheses.covariances[0], slopes @ joint @ slopes.T, atol=1e-6)
    assert np.abs(joint[:2, 3:5]).max() > 0.5 * joint[0, 0], "places are known by one start"


@pytest.mark.long
def test_what_stands_is_on_the_map_of_histories_in_which_it_may_move(tmp_path: Path) -> None:
    engine, random = Engine(moving_world.configuration(0.9)), np.random.default_rng(0)
    places, sigmas = np.array([[2.0, 0.0], [3.0, 1.0]]), np.array([0.05, 0.02])
    for k in range(15):
        polar = np.column_stack([np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])])
        polar += sigmas * random.normal(size=polar.shape)
        sights = [Detection(range_m=r, bearing_rad=b, covariance=np.diag(sigmas**2)) for r, b in polar]
        belief = engine.process(Keyframe.planar(k, detections=sights, motion_sigmas=(1e-3,) * 3))
    assert isinstance(engine.pool, InProcessPool)
    saved = write_map(tmp_path / "street.map", saved_map_of_engine(engine, engine.pool, belief))
    own = np.flatnonzero(saved.objects.existence > 0.5)
    kinds = {step.class_assignment for live in engine.live.values() for step in live.lineage}
    assert len(own) == len(places) and any(MOVES in kind for kind in kinds) and len(saved.hypotheses.log_weights) > 1
    np.testing.assert_allclose(saved.hypotheses.existence[:, own], 1.0, atol=0.02)
    for states in saved.hypotheses.states[:, own, :2]:
        np.testing.assert_allclose(states, places, atol=0.1)
    square = saved.hypotheses.covariances.reshape(-1, len(saved.objects.ids), 3, len(saved.objects.ids), 3)
    assert np.isfinite(square[:, own][:, :, :, own]).all()
    same_arrays(saved, read_map(tmp_path / "street.map"))


def test_a_map_names_the_region_that_its_run_has_learned() -> None:
    """By what a map has looked at and not seen, another one tells what is gone (``map diff``)."""
    sight, world = Detection(range_m=3.0, bearing_rad=0.4), {"learn_region": True, "learn_region_within_m": 5.0}
    engine = Engine(Configuration.of(association="open", semantic_model={"kind": "none"}, open_world=world))
    for k in range(30):
        belief = engine.process(Keyframe.planar(k, detections=[sight], motion_sigmas=(1e-3,) * 3))
    assert isinstance(engine.pool, InProcessPool)
    looks = saved_map_of_engine(engine, engine.pool, belief).looks
    direction, angle, nearest, farthest = looks.region
    assert len(looks.path) == 30 and direction == pytest.approx(0.4) and nearest < 3.0 < farthest < 5.0
    assert angle == pytest.approx(belief.noise["open_world.field_of_view_rad"])
    aside = np.array([[3.0 * np.cos(own), 3.0 * np.sin(own)] for own in (0.4, -0.4)])
    assert looks.counts(aside).tolist() == [30, 0]


def test_a_file_gives_the_map_back_to_the_last_bit(known: SavedMap, tmp_path: Path) -> None:
    written = write_map(tmp_path / "room.map", known)
    again = read_map(tmp_path / "room.map")
    same_arrays(written, again)
    assert again.map_id == known.map_id == written.map_id
    assert (again.provenance, again.class_names) == (known.provenance, known.class_names)


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_map_has_the_permissions_of_any_new_file(known: SavedMap, tmp_path: Path, umask: int, mode: int) -> None:
    """Else no other user could read what a manager saves that runs as root."""
    before = os.umask(umask)
    try:
        write_map(tmp_path / "room.map", known)
    finally:
        os.umask(before)
    assert (tmp_path / "room.map").stat().st_mode & 0o777 == mode


def test_a_map_that_cannot_be_written_is_one_line(known: SavedMap, tmp_path: Path) -> None:
    (tmp_path / ".room.map.unfinished").symlink_to("/dev/full")
    with pytest.raises(InputError, match=r"room.map: cannot be written \(No space left on device\); name another"):
        write_map(tmp_path / "room.map", known)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("part", ["class", "object"])
def test_a_name_that_no_reader_would_take_is_refused_before_the_map_is_written(
    known: SavedMap, tmp_path: Path, part: str
) -> None:
    long, objects = "x" * 1001, known.objects
    if part == "class":
        saved = replace(known, class_names=(*known.class_names[:-1], long))
    else:
        saved = replace(known, objects=replace(objects, names=(*objects.names[:-1], long)))
    with pytest.raises(InputError, match=r"1001 characters and a map takes 1000; shorten it, .* --labels"):
        write_map(tmp_path / "room.map", saved)
    assert not list(tmp_path.iterdir())


def test_the_next_run_starts_from_what_objects_have_in_common(known: SavedMap, tmp_path: Path) -> None:
    write_map(tmp_path / "room.map", known)
    prior = read_map_prior(tmp_path / "room.map")
    again = parse_map_prior(prior.to_json(), "as it travels")
    np.testing.assert_array_equal(again.joint_covariance, prior.joint_covariance)
    problem = problem_of(make_run_configuration(GIVEN, prior, *start_of_run(GIVEN, None, None), stamp_ns=0))
    assert problem.joint is not None
    _, covariance = closed_root(problem).joint_of_objects(problem.joint.object_ids)
    np.testing.assert_allclose(covariance, problem.joint.covariance, atol=1e-9)
    for entry in problem.objects:
        rows = slice(3 * entry.object_id, 3 * entry.object_id + 3)
        np.testing.assert_allclose(problem.joint.covariance[rows, rows], entry.prior.covariance, atol=1e-12)


def test_seeing_one_object_tells_where_the_others_are(known: SavedMap) -> None:
    """The second robot knows its place, and sees one object alone; the rest follows by the joint Gaussian."""
    (first, *_) = keyframes()
    alone = replace(first, measurements=first.measurements.take(np.array([0])))
    spreads = []
    for prior in (map_prior_of(known), replace(map_prior_of(known), joint_covariance=None)):
        belief = Engine(GIVEN, prior, initial_covariance=np.diag([0.01, 0.01, 0.003]) ** 2).process(alone)
        spreads.append(belief.object_covariances[1:, 0, 0])
    together, apart = spreads
    assert (together < 0.5 * apart).all()


def test_the_sigma_shown_is_that_of_the_direction_in_which_a_place_is_known_worst(known: SavedMap) -> None:
    """0.5 m along 30 degrees and 0.1 m across it."""
    axis, covariances = np.array([math.cos(math.pi / 6), math.sin(math.pi / 6)]), known.objects.covariances.copy()
    covariances[0, :2, :2] = 0.01 * np.eye(2) + 0.24 * np.outer(axis, axis)
    lines = lines_of(replace(known, objects=replace(known.objects, covariances=covariances)))
    assert lines[3].split()[4] == "0.500"


def test_a_map_knows_which_map_it_came_from(known: SavedMap) -> None:
    later = small_map(map_prior_of(known))
    assert later.provenance.started_from == known.map_id
    assert known.provenance.started_from != ""  # an objects.json has an id by its content


def test_a_session_from_a_merged_map_knows_all_maps_that_it_holds(known: SavedMap, tmp_path: Path) -> None:
    """By its file or an ``objects.json`` at the start, and in the map that it saves, with correlations or without."""
    other = with_id(replace(known, discarded_mass=0.5, provenance=Provenance(started_from="another")))
    both = write_map(tmp_path / "both.map", merged(known, other, "test", same_frame=True))
    held = {known.map_id, other.map_id, known.provenance.started_from, "another"}
    assert read_map(tmp_path / "both.map").ancestors == held
    engine, belief = run_to_its_end(read_map_prior(tmp_path / "both.map"))
    assert isinstance(engine.pool, InProcessPool)
    for later in (saved_map_of_engine(engine, engine.pool, belief), saved_map_of_belief(belief, engine.run)):
        written = write_map(tmp_path / "later.map", later)
        assert written.provenance.started_from == both.map_id
        assert read_map(tmp_path / "later.map").ancestors == {both.map_id, *held}
    (tmp_path / "objects.json").write_text(map_prior_of(written).to_json(), encoding="utf-8")
    assert read_map(tmp_path / "objects.json").ancestors == {written.map_id, both.map_id, *held}


def test_a_map_of_before_without_ancestors_keeps_its_id(tmp_path: Path) -> None:
    started = Provenance(started_from="0123456789abcdef", keyframe=7)
    old = with_id(replace(saved_map_of_prior(LOOSE), provenance=started))
    assert old.map_id == "738f270ce6971ad9", "as it was before ancestors were told"
    assert "ancestors" not in packed(old)[1]["provenance"]
    written = write_map(tmp_path / "old.map", old)
    assert read_map(tmp_path / "old.map").map_id == written.map_id == old.map_id
    assert map_prior_of(written).ancestors == ("0123456789abcdef",)


@pytest.mark.parametrize("ancestors", ["monday", [7], None])
def test_ancestors_that_are_no_ids_are_refused(known: SavedMap, tmp_path: Path, ancestors: object) -> None:
    document = map_prior_of(known).document() | {"ancestors": ancestors}
    with pytest.raises(InputError, match="ancestors is no list of map ids"):
        parse_map_prior(json.dumps(document), "objects.json")
    arrays, description = packed(known)
    description["provenance"]["ancestors"] = ancestors
    FORMAT.write(tmp_path / "odd.map", arrays, description)
    with pytest.raises(InputError, match="names are texts"):
        read_map(tmp_path / "odd.map")


def test_the_previous_version_is_read_as_a_map_of_independent_objects(tmp_path: Path) -> None:
    (tmp_path / "objects.json").write_text(LOOSE.to_json(), encoding="utf-8")
    migrated = read_map(tmp_path / "objects.json")
    assert not migrated.has_cross_covariances
    write_map(tmp_path / "new.map", migrated)
    prior = read_map_prior(tmp_path / "new.map")
    assert replace(prior, map_id="").to_json() == LOOSE.to_json()
    assert read_map_prior(tmp_path / "objects.json").to_json() == LOOSE.to_json()


def test_a_belief_alone_gives_its_marginals_and_says_so() -> None:
    engine, belief = run_to_its_end()
    saved = saved_map_of_belief(belief, engine.run)
    assert not saved.has_cross_covariances
    assert map_prior_of(saved).joint_covariance is None
    np.testing.assert_array_equal(saved.objects.poses, belief.object_poses)


@pytest.mark.parametrize("at", [0.1, 0.4, 0.7, 0.99])
def test_a_changed_byte_is_told(known: SavedMap, tmp_path: Path, at: float) -> None:
    write_map(tmp_path / "room.map", known)
    content = bytearray((tmp_path / "room.map").read_bytes())
    content[int(at * len(content))] ^= 1
    (tmp_path / "room.map").write_bytes(bytes(content))
    with pytest.raises(InputError, match=r"room\.map: .*semantic_slam map save"):
        read_map(tmp_path / "room.map")


@pytest.mark.parametrize(
    ("name", "change", "text"),
    [
        ("objects.existence", lambda values: values + 0.1, "existence is no probability"),
        ("objects.ids", lambda values: values * 0, "ids are not different numbers"),
        ("objects.poses", lambda values: values * math.nan, "poses are not finite"),
        ("hypotheses.log_weights", lambda values: values - 1.0, "do not add up to one"),
        ("hypotheses.covariances", lambda values: -values, "not symmetric and positive semi-definite"),
        ("hypotheses.covariances", lambda values: values[:, :3, :3].copy(), "has the shape"),
        ("hypotheses.states", lambda values: values.astype(np.float32), "holds float32"),
    ],
)
def test_impossible_content_is_refused(known: SavedMap, tmp_path: Path, name: str, change: object, text: str) -> None:
    write_map(tmp_path / "room.map", known)
    arrays = load_file(tmp_path / "room.map")
    header = json.loads((tmp_path / "room.map").read_bytes()[8:].split(b"}}", 1)[0].decode() + "}}")
    arrays[name] = change(arrays[name])  # type: ignore[operator]
    save_file(arrays, tmp_path / "room.map", metadata=header["__metadata__"])
    with pytest.raises(InputError, match=r"room\.map: no whole map") as caught:
        read_map(tmp_path / "room.map")
    assert text in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"\0" * 40, b"\xff" * 8 + b"\0" * 20])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "other.map").write_bytes(content)
    with pytest.raises(InputError, match=r"other\.map"):
        read_map(tmp_path / "other.map")


def test_a_pipe_that_nobody_writes_to_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(pipe := tmp_path / "pipe.map")
    with pytest.raises(InputError, match="is no file; name an existing"):
        read_map_prior(pipe)
