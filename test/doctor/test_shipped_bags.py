"""The shipped bags are healthy; what is wrong with their clocks, camera or noise, the drive itself tells."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.bags.bag_factory import map_prior, write_bag
from worlds.bags.mistakes import each, varied
from worlds.bags.places import place_entries
from worlds.bags.spoiled_bag import Change, later, spoiled

from semantic_slam.cli import doctor
from semantic_slam.cli.exit_codes import BAD_INPUT, DONE, exit_code
from semantic_slam.configuration import from_dict
from semantic_slam.doctor.bag_summary import summarise_bag
from semantic_slam.doctor.examination import examine
from semantic_slam.doctor.finding import Finding
from semantic_slam.messages import topics
from semantic_slam.pipeline.offline import run_bag

BAGS = Path(__file__).parents[2] / "bags"
ROOM = BAGS / "aliased_room"
OPEN = {"association": "open"}


def examined(bag: Path, configuration: dict[str, Any]) -> list[Finding]:
    summary, faults = summarise_bag(bag, from_dict(configuration), None)
    return [*faults, *examine(summary)]


def turned(quaternion: tuple[float, float, float, float]) -> Change:
    """The camera's mount with another rotation."""

    def change(message: Any) -> Any:
        rotation = message.transforms[0].transform.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = quaternion
        return message

    return change


def jumping() -> Change:
    """Odometry of wheels that slip: 0.5 m off at every sample."""
    chance = np.random.default_rng(0)

    def change(message: Any) -> Any:
        place = message.pose.pose.position
        place.x, place.y = place.x + chance.normal(0.0, 0.5), place.y + chance.normal(0.0, 0.5)
        return message

    return change


@pytest.mark.parametrize("bag", ["aliased_room", "standing.mcap"])
def test_shipped_bags_are_healthy(
    bag: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["semantic_slam doctor", str(BAGS / bag)])
    assert exit_code(doctor.command) == DONE
    assert capsys.readouterr().out == "nothing wrong\n"


def test_a_belief_bag_is_examined_as_the_run_that_it_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag", each(topics.DETECTIONS, varied)(place_entries("ranges", 24)))
    run_bag(bag, tmp_path / "belief", from_dict({"semantic_model": {"kind": "none"}}), map_prior())
    capsys.readouterr()
    words = ["semantic_slam doctor", str(tmp_path / "belief")]
    monkeypatch.setattr("sys.argv", words)
    assert exit_code(doctor.command) == DONE
    told = capsys.readouterr()
    assert told.out == "nothing wrong\n" and "belief: a recorded run; its configuration and map" in told.err
    monkeypatch.setattr("sys.argv", [*words, "--config", "default"])
    assert exit_code(doctor.command) == BAD_INPUT
    assert "no class scores" in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "check", "words"),
    [
        ({"/odom": later(3.0)}, "clocks", ("odometry of 3.0 s later", "odometry.clock_offset_s near 3")),
        ({"/tf_static": turned((0.5, 0.5, -0.5, -0.5))}, "extrinsics", ("looks backwards", "optical frame")),
        ({"/tf_static": turned((-0.7071, 0.0, 0.0, 0.7071))}, "extrinsics", ("looks to the right", "optical frame")),
        ({"/odom": jumping()}, "noise", ("times as far apart", "semantic_slam calibrate")),
    ],
    ids=["odometry 3 s late", "camera backwards", "camera to the left", "odometry that slips"],
)
def test_what_the_drive_contradicts_is_found(
    tmp_path: Path, changes: Mapping[str, Change], check: str, words: tuple[str, ...]
) -> None:
    found = examined(spoiled(ROOM, tmp_path / "bag", changes), OPEN)
    print([finding.line for finding in found])
    assert [finding.check for finding in found] == [check]
    assert all(word in found[0].line for word in words)


def test_a_file_with_keys_outside_ros_parameters_is_one_line_and_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("/**:\n  ros__parameters:\n    seed: 1\n  association: open\n")
    monkeypatch.setattr("sys.argv", ["semantic_slam doctor", str(ROOM), "--config", str(path)])
    assert exit_code(doctor.command) == BAD_INPUT
    output = capsys.readouterr()
    (line,) = output.out.splitlines()
    assert (
        line.startswith("error: configuration: ")
        and "'association' stands beside" in line
        and "parameters below that" in line
    )
    assert output.err.endswith("1 error and 0 warnings; see the remedies\n")
