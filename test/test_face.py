"""The face of the package: what a plain Python session imports from it, feeds it and reads from its beliefs."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import semantic_slam
from semantic_slam import (
    Configuration,
    Detection,
    Engine,
    HybridBelief,
    InputError,
    Keyframe,
    MapPrior,
    ObjectPrior,
    load_configuration,
    read_map,
    read_map_prior,
    run_bag,
)

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "engine.py"
GEOMETRY = Configuration.of(semantic_model={"kind": "none"})
CLASSES = Configuration.of(semantic_model={"kind": "parametric"})
MAP = MapPrior(tuple(ObjectPrior.planar(n, 2.0 * n, 1.0, sigma_m=0.1, sigma_rad=0.1) for n in range(4)))

WITHOUT_ROS = """
import sys
for name in ("rclpy", "std_msgs", "semantic_slam_msgs", "ament_index_python"):
    sys.modules[name] = None  # an import of it raises ImportError
from semantic_slam import Configuration, Detection, Engine, Keyframe
engine = Engine(Configuration.of(association="open", semantic_model={"kind": "none"}))
for k in range(3):
    seen = [Detection.at(2.0 - 0.5 * k, 0.5)]
    belief = engine.process(Keyframe.planar(k, motion=(0.5 if k else 0, 0, 0), detections=seen))
(only,) = belief.objects
assert abs(only.position[:2] - (2.0, 0.5)).max() < 0.05, only
assert only.existence > 0.9 and sum(h.weight for h in belief.hypotheses) > 0.999
print(belief.table()[0]["name"])
"""


NO_NETWORKS = "assert not {'torch', 'rosbags', 'cv2'} & set(sys.modules)"


@pytest.mark.slow
def test_the_engine_works_in_a_plain_session_without_ros_and_loads_no_networks() -> None:
    told = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS + NO_NETWORKS], capture_output=True, text=True, timeout=120
    )
    assert told.returncode == 0, told.stderr
    assert len(WITHOUT_ROS.strip().splitlines()) <= 15


def test_every_name_is_there_and_costs_nothing_before_it_is_asked_for() -> None:
    for name in semantic_slam.__all__:
        assert getattr(semantic_slam, name) is not None
    assert set(semantic_slam.__all__) <= set(dir(semantic_slam))
    with pytest.raises(AttributeError, match="no attribute 'Motor'"):
        semantic_slam.Motor  # noqa: B018
    line = "import semantic_slam, sys; assert not {'numpy', 'gtsam', 'torch'} & set(sys.modules)"
    assert subprocess.run([sys.executable, "-c", line]).returncode == 0


def process(configuration: Configuration, *detections: Detection, map_prior: MapPrior | None = MAP) -> HybridBelief:
    """The belief after one keyframe of a robot that stands at the origin."""
    return Engine(configuration, map_prior).process(Keyframe.planar(0, detections=detections))


def test_a_point_is_its_range_and_bearing() -> None:
    point, polar = Detection.at(2.0, 1.0), Detection(range_m=np.sqrt(5.0), bearing_rad=np.arctan2(1.0, 2.0))
    some, others = process(GEOMETRY, point), process(GEOMETRY, polar)
    np.testing.assert_allclose(some.object_poses, others.object_poses, atol=1e-12)


def test_the_covariance_of_a_point_turns_with_it() -> None:
    round_one = Detection.at(3.0, 4.0, covariance=0.04 * np.eye(2))
    np.testing.assert_allclose(round_one.covariance_or_nan(), np.diag([0.04, 0.04 / 25.0]), atol=1e-12)


def test_noise_that_nobody_tells_is_the_configured_one() -> None:
    told = Detection(range_m=2.0, bearing_rad=0.4, covariance=np.diag([0.3**2, 0.02**2]))
    left_out = Detection(range_m=2.0, bearing_rad=0.4)
    sigmas = {"perception": {"sigma_range_m": 0.3, "sigma_bearing_rad": 0.02}, "semantic_model": {"kind": "none"}}
    some, others = process(GEOMETRY, told), process(Configuration.of(**sigmas), left_out)
    np.testing.assert_array_equal(some.poses, others.poses)
    assert not np.array_equal(some.poses, process(GEOMETRY, left_out).poses)


def test_motion_noise_that_nobody_tells_is_the_configured_one() -> None:
    noise = {"sigma_translation_per_m": 0.1, "sigma_translation_floor_m": 0.3, "sigma_rotation_per_m": 0.2}
    configuration = Configuration.of(semantic_model={"kind": "none"}, odometry=noise)
    sigma_m, sigma_rad = np.hypot(0.3, 0.1 * 2.0), np.hypot(0.005, 0.2 * 2.0)
    drives = [
        Keyframe.planar(0, motion=(2.0, 0.0, 0.0), motion_sigmas=sigmas)
        for sigmas in (None, (sigma_m, sigma_m, sigma_rad))
    ]
    left_out, told = (Engine(configuration, MAP).process(drive) for drive in drives)
    np.testing.assert_allclose(left_out.pose_covariances, told.pose_covariances, rtol=1e-12, atol=1e-15)


def test_class_scores_are_the_features_of_the_class_models_whatever_their_order() -> None:
    near = {"range_m": 2.2, "bearing_rad": 0.5}
    forwards = process(CLASSES, Detection(**near, class_scores={"class_1": 0.9, "class_2": 0.1}))
    backwards = process(CLASSES, Detection(**near, class_scores={"class_2": 0.1, "class_1": 0.9}))
    np.testing.assert_array_equal(forwards.class_probabilities, backwards.class_probabilities)
    (seen, *_), row = forwards.hypotheses[0].associations, 0
    row = [known.object_id for known in forwards.objects].index(seen)
    assert forwards.objects[row].likeliest_class == "class_1"
    assert forwards.objects[row].class_probabilities["class_1"] > 0.6


def test_what_is_read_by_name_is_what_the_arrays_say() -> None:
    belief = process(CLASSES, Detection(range_m=2.2, bearing_rad=0.5, class_scores={"class_1": 0.9, "class_2": 0.1}))
    for row, known in enumerate(belief.objects):
        assert (known.object_id, known.name) == (belief.object_ids[row], belief.object_names[row])
        assert list(known.class_probabilities.values()) == belief.class_probabilities[row].tolist()
        np.testing.assert_array_equal(known.position, belief.object_poses[row, :3])
        assert known.yaw_rad == pytest.approx(2.0 * np.arctan2(*belief.object_poses[row, 5:]))
    assert sum(hypothesis.weight for hypothesis in belief.hypotheses) == pytest.approx(1.0)
    for row, hypothesis in enumerate(belief.hypotheses):
        expected = [belief.object_ids[n] if n >= 0 else -1 for n in belief.associations[row]]
        assert list(hypothesis.associations) == expected
    table = belief.table()
    assert [each["x_m"] for each in table] == belief.object_poses[:, 0].tolist()
    assert {len(each) for each in table} == {len(table[0])} and "p_class_1" in table[0]


def test_a_detection_alone_is_clutter_where_identities_are_given() -> None:
    belief = process(Configuration.of(association="given", semantic_model={"kind": "none"}), Detection(bearing_rad=0.1))
    assert belief.hypotheses[0].associations == (-1,)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"range_m": float("nan"), "bearing_rad": 0.0}, "range_m is nan.*None for a bearing alone"),
        ({"range_m": -1.0, "bearing_rad": 0.0}, "range_m is -1.0.*above 0"),
        ({"bearing_rad": float("inf")}, "bearing_rad is inf"),
        ({"bearing_rad": 0.0, "class_scores": {"chair": float("nan")}}, "chair is nan"),
        ({"bearing_rad": 0.0, "covariance": [[1.0, 2.0], [2.0, 1.0]]}, "positive definite"),
        ({"bearing_rad": 0.0, "covariance": np.diag([-0.1, 0.1])}, "positive definite"),
        ({"bearing_rad": 0.0, "covariance": np.eye(3)}, "2 x 2"),
        ({"bearing_rad": 0.0, "covariance": [[1.0, 2.0], [3.0]]}, "2 x 2"),
        ({"bearing_rad": 0.0, "covariance": "abc"}, "2 x 2"),
        ({"bearing_rad": 0.0, "range_m": "3"}, "range_m is '3'; give metres above 0"),
        ({"bearing_rad": None}, "bearing_rad is None; leave detections out"),
        ({"bearing_rad": 0.0, "class_scores": {"chair": "much"}}, "chair is 'much'"),
        ({"bearing_rad": 0.0, "class_scores": [1.0, 2.0]}, "give a score for each class"),
        ({"bearing_rad": 0.0, "embedding": ["x"]}, "one row of finite numbers"),
    ],
)
def test_a_detection_that_cannot_be_is_refused_with_the_remedy(wrong: dict, told: str) -> None:
    with pytest.raises(InputError, match=told):
        Detection(**wrong)


def test_a_point_without_numbers_is_refused() -> None:
    for x_m, y_m in ((float("nan"), 0.0), (1.0, "2")):
        with pytest.raises(InputError, match="leave out what has no place in metres"):
            Detection.at(x_m, y_m)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"motion": (1.0, 0.0)}, "three finite numbers"),
        ({"motion": (1.0, 0.0, float("nan"))}, "three finite numbers"),
        ({"motion": "abc"}, "three finite numbers"),
        ({"motion_sigmas": (0.1, -0.1, 0.1)}, "above 0"),
        ({"detections": None}, "no list of Detection; give one, empty if there are none"),
        ({"detections": Detection(bearing_rad=0.0)}, "no list of Detection"),
        ({"detections": [{"range_m": 1.0}]}, "no list of Detection"),
        ({"stamp_ns": 0.5}, "stamp_ns is 0.5; give a whole number"),
        ({"stamp_ns": float("nan")}, "stamp_ns is nan; give a whole number"),
        ({"stamp_ns": 2**70}, "at most 64 bits"),
    ],
)
def test_a_keyframe_that_cannot_be_is_refused_with_the_remedy(wrong: dict, told: str) -> None:
    with pytest.raises(InputError, match=told):
        Keyframe.planar(0, **wrong)


@pytest.mark.parametrize(
    ("scores", "told"),
    [
        ({}, "no class scores; the class models know class_1, class_2.*semantic_model.kind: none"),
        ({"mug": 1.0, "class_1": 0.0, "class_2": 0.0}, "'mug' is of an unknown class"),
        ({"class_1": 1.0}, "without a score for every class"),
    ],
)
def test_scores_that_the_class_models_do_not_take_are_refused(scores: dict[str, float], told: str) -> None:
    with pytest.raises(InputError, match=told):
        process(CLASSES, Detection(range_m=2.0, bearing_rad=0.4, class_scores=scores))


def test_a_start_or_a_map_that_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="initial_pose"):
        Engine(GEOMETRY, MAP, initial_pose=(0.0, float("nan"), 0.0))
    with pytest.raises(InputError, match="initial_covariance is not symmetric and positive definite"):
        Engine(GEOMETRY, MAP, initial_covariance=-np.eye(3))
    with pytest.raises(InputError, match="no map prior"):
        Engine(GEOMETRY)
    with pytest.raises(InputError, match="initial_pose"):
        Engine(GEOMETRY, MAP, initial_pose="abc")
    for quaternion in ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 1.0)):
        with pytest.raises(InputError, match="no quaternion of unit length; normalise it"):
            Engine(GEOMETRY, MAP, initial_pose=(1.0, 2.0, 0.0, *quaternion))
    with pytest.raises(InputError, match="has a roll or a pitch; give a turn about z alone"):
        Engine(GEOMETRY, MAP, initial_pose=(1.0, 2.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="give a standard deviation of 0 or more"):
        ObjectPrior.planar(1, 1.0, 1.0, sigma_m=-0.1, sigma_rad=0.1)
    for backends in (0, -1, 2.5):
        with pytest.raises(InputError, match=f"backends is {backends}; give a whole number of at least one"):
            Engine(GEOMETRY, MAP, backends=backends)
    with pytest.raises(InputError, match="choose one of enumerated, given, open"):
        Engine(Configuration(association="clairvoyant"))


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"semantic_model": {"kind": "parametric"}}, "points have no heading.*set semantic_model.kind: none"),
        ({"semantic_model": {"kind": "none"}, "association": "open"}, "set association: enumerated, or given"),
    ],
)
def test_points_are_refused_where_headings_or_births_are_wanted(values: dict, told: str) -> None:
    with pytest.raises(InputError, match=told):
        Engine(Configuration.of(observation="points", **values), MAP)


def test_points_are_estimated_without_a_heading() -> None:
    configuration = Configuration.of(observation="points", semantic_model={"kind": "none"})
    belief = process(configuration, Detection.at(2.0, 1.0))
    assert {known.yaw_rad for known in belief.objects} == {0.0}
    assert all(known.covariance[0, 0] < 0.02 for known in belief.objects)


def test_keyframes_out_of_order_are_refused() -> None:
    engine = Engine(GEOMETRY, MAP)
    engine.process(Keyframe.planar(0))
    for wrong in (0, 2):
        with pytest.raises(InputError, match=f"keyframe {wrong} came in place of 1"):
            engine.process(Keyframe.planar(wrong))


def test_a_keyframe_before_the_last_one_is_refused_and_the_run_goes_on_as_without_it() -> None:
    engine, untouched = Engine(GEOMETRY, MAP), Engine(GEOMETRY, MAP)
    seen = {"detections": [Detection.at(2.0, 1.0)]}
    for each in (engine, untouched):
        each.process(Keyframe.planar(0, stamp_ns=10, **seen))
    with pytest.raises(InputError, match="keyframe 1: its stamp of 9 ns is before the 10 ns of keyframe 0; give keyf"):
        engine.process(Keyframe.planar(1, stamp_ns=9, **seen))
    for stamp_ns in (10, 11):  # one of the same time is none before it
        index = stamp_ns - 9
        belief, expected = (each.process(Keyframe.planar(index, stamp_ns=stamp_ns)) for each in (engine, untouched))
        np.testing.assert_array_equal(belief.poses, expected.poses)
        np.testing.assert_array_equal(belief.hypothesis_ids, expected.hypothesis_ids)


def test_files_are_named_by_text_or_by_path() -> None:
    settings, known = ROOT / "config" / "default.yaml", ROOT / "bags" / "aliased_room" / "objects.json"
    assert load_configuration(str(settings)) == load_configuration(settings)
    assert read_map_prior(str(known)).to_json() == read_map_prior(known).to_json()
    assert read_map(str(known)).map_id == read_map(known).map_id


def test_a_run_over_a_bag_is_named_by_text_or_by_path_and_has_one_keyframe_at_least(tmp_path: Path) -> None:
    bag, beliefs = tmp_path / "bag", tmp_path / "beliefs"
    with pytest.raises(InputError, match=r"bag: no such bag; give"):
        run_bag(str(bag), str(beliefs), GEOMETRY, MAP)
    for none in (0, -1):
        with pytest.raises(InputError, match=f"max_keyframes is {none}; give 1 or more, or None for the whole bag"):
            run_bag(bag, beliefs, GEOMETRY, MAP, max_keyframes=none)
    assert not beliefs.exists()


@pytest.mark.long
@pytest.mark.slow
def test_the_lost_robot_of_the_example_finds_itself_and_leaves_no_file_unasked(tmp_path: Path) -> None:
    command = [sys.executable, EXAMPLE]
    headless = os.environ | {"MPLBACKEND": "agg"}
    told = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path, env=headless)
    assert told.returncode == 0, told.stderr
    first, *_, last = [re.findall(r"[\d.]+", line.partition("weights")[2]) for line in told.stdout.splitlines()]
    assert len(first) == 5 and max(map(float, first)) < 0.5 and list(map(float, last)) == [1.0]
    assert list(tmp_path.iterdir()) == []
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) <= 42


@pytest.mark.slow
def test_the_example_draws_its_picture_and_never_over_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture = tmp_path / "engine.png"
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), str(picture)])
    monkeypatch.setenv("MPLBACKEND", "agg")
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert picture.stat().st_size > 20_000
    with pytest.raises(SystemExit, match="2"):
        runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert picture.stat().st_size > 20_000


@pytest.mark.slow
@pytest.mark.parametrize("name", ["engine", "offline", "detector_node"])
def test_an_example_tells_its_arguments_and_writes_nothing(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example = str(EXAMPLE.with_name(f"{name}.py"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [example, "--help"])
    with pytest.raises(SystemExit, match="0"):
        runpy.run_path(example, run_name="__main__")
    assert capsys.readouterr().out.startswith(f"usage: {name}.py [-h]")
    assert list(tmp_path.iterdir()) == []


def test_the_offline_example_says_in_one_line_that_there_is_no_such_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example = str(EXAMPLE.with_name("offline.py"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [example, "nowhere", "belief"])
    with pytest.raises(SystemExit, match="2"):
        runpy.run_path(example, run_name="__main__")
    assert capsys.readouterr().err.splitlines()[-1].startswith("offline.py: error: nowhere: no such bag; give a ")


@pytest.mark.slow
def test_the_session_of_the_page_runs_and_prints_what_the_page_shows(capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    session = "".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL))
    (shown,) = re.findall(r"```text\n(.*?)```", page, re.DOTALL)
    exec(compile(session, "python.md", "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out.startswith(shown)
    chair, table = (re.search(f"object_{n} .*{{'class_1': (.*), 'class_2': (.*)}}", shown) for n in (2, 3))
    assert chair and float(chair[1]) > 0.6 and table and float(table[2]) > 0.8
