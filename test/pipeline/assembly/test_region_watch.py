"""A run says at its console, early and once, that many detections lie outside of the stated region."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.bags.bag_factory import write_bag, write_configuration
from worlds.bags.places import entries_to_and_fro

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.messages import topics
from semantic_slam.pipeline.assembly.places_assembler import PlacesAssembler
from semantic_slam.pipeline.assembly.region_watch import ENOUGH, RegionWatch
from semantic_slam.pipeline.session import Session
from semantic_slam.pipeline.shared_run import run_shared

NARROW = {"field_of_view_rad": 0.05}
"""Both objects of the bag lie outside."""
NEAR = {"learn_region": True, "learn_region_within_m": 1.0}
NUM_FRAMES = (ENOUGH + 1) // 2


def told(*frames: tuple[int, int], **settings: Any) -> list[list[str]]:
    """The lines after each frame of so many detections, of which so many lie outside."""
    watch, lines = RegionWatch(Configuration.of(**settings)), list[list[str]]()
    for seen, outside in frames:
        watch.count(seen, outside)
        lines.append(watch.news())
    return lines


def test_it_is_said_once_as_soon_as_there_are_enough() -> None:
    before, (line,), after = told((ENOUGH - 10, 3), (10, 1), (50, 50))
    assert before == after == []
    assert line.startswith(f"4 of the first {ENOUGH} detections lie outside of the region that open_world states")
    assert "set open_world.learn_region: true and learn_region_within_m, or" in line


def test_fewer_than_a_tenth_are_no_news() -> None:
    assert told(*[(10, 0)] * 9, (10, 9), *[(100, 9)] * 20) == [[]] * 30


def test_the_remedy_in_space_is_none_that_space_refuses() -> None:
    ((line,),) = told((ENOUGH, ENOUGH), state_space="spatial")
    assert "learn_region" not in line and "semantic_slam doctor" in line


def test_of_a_learned_region_it_is_the_range_that_is_too_short() -> None:
    ((line,),) = told((ENOUGH, ENOUGH), open_world={"learn_region": True, "learn_region_within_m": 5.0})
    assert "lie beyond open_world.learn_region_within_m, and are not used; raise it" in line


@pytest.mark.parametrize("processes", [1, 2])
@pytest.mark.parametrize(("region", "lines"), [(NARROW, 1), ({**NARROW, "learn_region": True}, 0), (NEAR, 1)])
def test_the_line_is_that_of_the_bag_whichever_process_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], processes: int, region: dict[str, Any], lines: int
) -> None:
    configuration = write_configuration(tmp_path / "configuration", association="open", open_world=region)
    bag = write_bag(tmp_path / "bag", entries_to_and_fro(NUM_FRAMES))
    run_shared(bag, tmp_path / "belief", load_configuration(configuration), processes=processes)
    found = [line for line in capsys.readouterr().out.splitlines() if "and are not used" in line]
    assert len(found) == lines and all(line.startswith(f"{bag}: ") for line in found)


def test_a_live_session_says_it_once(tmp_path: Path) -> None:
    configuration = load_configuration(write_configuration(tmp_path, association="open", open_world=NARROW))
    session, places = Session(configuration, None, ""), PlacesAssembler(configuration, lambda _: np.zeros(7))
    pool, lines = InProcessPool(1), []
    for entry in entries_to_and_fro(NUM_FRAMES + 5):
        if entry.topic == topics.ODOMETRY:
            session.assembler.add_odometry(entry.message)
        else:
            places.add_detections(entry.message)
        for measured in places.take():
            session.assembler.add_measurements(measured)
        assert all(belief.keyframe == keyframe.index for keyframe, belief in session.beliefs(pool))
        lines += session.news()
    assert len(lines) == 1
