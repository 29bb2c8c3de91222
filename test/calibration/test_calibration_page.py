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
from semantic_slam.evaluation.record import GroundTruth, Record
from semantic_slam.evaluation.trajectory import Trajectory

SECOND = 1_000_000_000


def straight(first_ns: int, last_ns: int) -> Trajectory:
    """Along x at 1 m/s."""
    stamps = np.linspace(first_ns, last_ns, 50).astype(np.int64)
    poses = np.zeros((len(stamps), 7))
    poses[:, 0], poses[:, 6] = (stamps - first_ns) * 1e-9, 1.0
    return Trajectory(stamps, poses)


def calibration(changes: dict[str, Change], *, has_truth: bool = False) -> Calibration:
    """A candidate of 4 nats more, which is not enough to be kept."""
    nowhere = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7)))
    beliefs = tuple(small_belief(k, [1], [0], [1.0], [1], [[0]]) for k in range(4))
    path = straight(beliefs[0].stamp_ns - 2 * SECOND, beliefs[-1].stamp_ns + 2 * SECOND) if has_truth else nowhere
    truth = GroundTruth(path, None, {}) if has_truth else None
    record = Record(run_configuration(Path("drive"), CLASSES, tuple("1234567")), beliefs, path, {}, truth)
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


def test_no_table_loses_the_heads_that_tell_its_numbers_apart_on_a_narrow_page() -> None:
    """Tables of metrics do: each has one number, and its name beside it."""
    page = render_page(calibration({}, has_truth=True), "default.yaml")
    hidden = set(re.findall(r"\.([\w-]+) thead \{ display: none; \}", page))
    heads = re.findall(r'<table(?: class="([\w -]+)")?>\s*<thead>(.*?)</thead>', page, re.DOTALL)
    assert "metrics" in hidden and any("<th>Bias</th>" in head for _, head in heads)
    assert all(head.count('<th class="num">') < 2 for names, head in heads if hidden & set(names.split()))
