"""All that a map knows of one object: in Python, by the command, and (as tested with the services) over ROS."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.studies.embeddings.known_map import map_of
from worlds.bags.bag_factory import write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.commands import call

from semantic_slam import InputError, get_object, read_record
from semantic_slam.cli.find_object import table
from semantic_slam.configuration import load_configuration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.pipeline.offline import run_bag


@pytest.fixture
def belief() -> HybridBelief:
    """Three objects with other numbers than rows; one class is likelier for each."""
    return replace(
        map_of(3),
        object_ids=np.array([7, 2, 9], dtype=np.uint32),
        object_names=("door", "2", "9"),
        class_names=("chair", "cup"),
        class_probabilities=np.array([[0.9, 0.1], [0.2, 0.8], [0.5, 0.5]]),
        hypothesis_class_probabilities=np.zeros((1, 3, 2)),
        existence=np.array([0.1, 0.2, 0.3]),
        moving=np.array([0.4, 0.5, 0.6]),
        moved=np.array([0.7, 0.8, 0.9]),
        missing=np.array([0.15, 0.25, 0.35]),
        mutual_information=np.array([1.0, 2.0, 3.0]),
        in_coverage=np.array([True, False, True]),
    )


def test_an_object_is_told_by_its_number_and_not_by_its_row(belief: HybridBelief) -> None:
    known = get_object(belief, 2)
    assert (known.object_id, known.name, known.class_probabilities) == (2, "2", {"chair": 0.2, "cup": 0.8})
    assert (known.existence, known.moving, known.moved, known.missing) == (0.2, 0.5, 0.8, 0.25)
    assert (known.mutual_information, known.in_coverage, known.likeliest_class) == (2.0, False, "cup")
    np.testing.assert_array_equal(known.pose, belief.object_poses[1])
    np.testing.assert_array_equal(known.covariance, belief.object_covariances[1])


def test_an_object_is_told_by_its_name_or_its_number_as_text(belief: HybridBelief) -> None:
    assert get_object(belief, "door").object_id == get_object(belief, "7").object_id == get_object(belief, 7).object_id


def test_a_text_is_the_name_of_an_object_before_it_is_the_number_of_another(belief: HybridBelief) -> None:
    """As on the map of a run that took its names from a tracker."""
    tracked = replace(belief, object_ids=np.array([0, 1, 2], dtype=np.uint32), object_names=("2", "7", "0"))
    assert [get_object(tracked, name).object_id for name in ("2", "7", "0", "1")] == [0, 1, 2, 1]
    assert [get_object(tracked, number).name for number in range(3)] == ["2", "7", "0"]


def test_what_a_run_does_not_estimate_is_not_a_number() -> None:
    known = get_object(map_of(1), 0)
    assert np.isnan([known.moving, known.moved, known.missing, known.mutual_information]).all()
    assert (known.class_probabilities, known.likeliest_class) == ({}, "")


def test_an_object_that_is_not_there_is_refused_with_those_that_are(belief: HybridBelief) -> None:
    with pytest.raises(InputError, match="object 3 is not on the map, which has 7, 2, 9; ask for one of these"):
        get_object(belief, 3)
    with pytest.raises(InputError, match=r"the map has no object 'gate'; ask for one of 7 \(door\), 2, 9"):
        get_object(belief, "gate")


def test_the_table_has_every_quantity_and_the_likeliest_class_first(belief: HybridBelief) -> None:
    told = dict(line.split("  ", 1) for line in table(get_object(belief, 2)))
    told = {name.strip(): value.strip() for name, value in told.items()}
    assert told["object"] == "2" and told["existence"] == "0.2000" and told["views in coverage"] == "no"
    assert told["x [m]"] == "1.00 +- 0.01" and told["yaw [deg]"] == "0 +- 1"
    assert list(told)[-2:] == ["class cup", "class chair"] and told["class cup"] == "0.8000"
    unknown = [line for line in table(get_object(map_of(1), 0)) if line.endswith("  -")]
    assert [line.split()[0] for line in unknown] == ["moving", "moved", "missing", "mutual"]


@pytest.mark.slow
def test_the_command_tells_what_the_last_belief_of_a_run_knows(tmp_path: Path) -> None:
    configuration = load_configuration(write_configuration(tmp_path / "configuration"))
    run_bag(write_bag(tmp_path / "bag", place_entries("ranges")), tmp_path / "belief", configuration, max_keyframes=2)
    known = get_object(read_record(tmp_path / "belief").beliefs[-1], 1)
    result = call(tmp_path, "semantic_slam.cli.find", tmp_path / "belief", "--object", known.name)
    assert (result.returncode, result.stdout.splitlines()) == (0, table(known))
    result = call(tmp_path, "semantic_slam.cli.find", tmp_path / "belief", "--object", "99")
    assert result.returncode == 2 and result.stderr.startswith("the map has no object '99'; ask for one of ")
    result = call(tmp_path, "semantic_slam.cli.find", tmp_path / "belief", "--object", "0", "--place")
    assert result.returncode == 2 and "give one of CROP, --name, --vector, --place and --object" in result.stderr
