"""What the page of a calibration says where no candidate is clearly better."""

import re
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import CLASSES, run_configuration, small_belief

from semantic_slam.calibration.calibrate import Calibration
from semantic_slam.calibration.page import render_page
from semantic_slam.calibration.search import Change, Trial
from semantic_slam.calibration.trial import Drive, Weighed
from semantic_slam.configuration import Configuration
from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import Trajectory


def calibration(changes: dict[str, Change]) -> Calibration:
    """A candidate of 4 nats more, which is not enough to be kept."""
    nowhere = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7)))
    beliefs = tuple(small_belief(k, [1], [0], [1.0], [1], [[0]]) for k in range(2))
    record = Record(run_configuration(Path("drive"), CLASSES, tuple("1234567")), beliefs, nowhere, {}, None)
    weighed = Weighed(34.8, Path("belief"), num_keyframes=2, num_detections=2)
    trial = Trial(
        quantity="noise of detections", values={"perception.sigma_range_m": 0.05}, log_evidence=38.8, gain=4.0
    )
    return Calibration(
        drive=Drive(bag=Path("drive.mcap")),
        before=Configuration(),
        after=Configuration(),
        changes=changes,
        trials=[trial],
        first=weighed,
        last=weighed,
        record_before=record,
        record_after=record,
    )


def test_a_candidate_that_is_a_little_better_is_not_said_to_be_none() -> None:
    page = render_page(calibration({}), "default.yaml")
    lead = re.search(r'<p class="lead">(.*?)</p>', page)
    assert lead is not None
    assert lead[1] == "No candidate is at least 5 nats better than <code>default.yaml</code>, so nothing was changed."
    assert ">4.0</td>" in page


@pytest.mark.parametrize("is_changed", [True, False])
def test_the_evidence_gained_is_drawn_where_something_was_changed(is_changed: bool) -> None:
    changes = (
        {"perception.sigma_range_m": Change(before=0.1, after=0.05, quantity="noise of detections", gain=9.0)}
        if is_changed
        else {}
    )
    page = render_page(calibration(changes), "default.yaml")
    assert ("Evidence gained" in page) == is_changed
    assert ("What was inferred" in page) == is_changed  # these beliefs infer no noise
