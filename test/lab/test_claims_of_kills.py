"""What is said of runs whose nodes are killed: which numbers count as the same, and what shows nothing."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from semantic_slam_lab.fuzz.answers import believed
from semantic_slam_lab.fuzz.results import Forged, write_forged
from semantic_slam_lab.kills.claims import claim_of_everything, claim_of_nodes
from semantic_slam_lab.kills.comparison import TOLERANCE, largest_difference
from semantic_slam_lab.kills.trials import EVERYTHING, Trial

from semantic_slam.inference.belief import HybridBelief

EQUAL = Trial("backend_0", (10, 20), 67, 67, 0.0)
OFF = Trial(EVERYTHING, (7,), 67, 67, 1e-6)


def test_kills_hold_where_every_number_is_equal() -> None:
    claims = claim_of_nodes([EQUAL, OFF]), claim_of_everything([EQUAL, OFF], 1)
    assert [claim is not None and claim.holds for claim in claims] == [True, False]
    assert claims[0] is not None and "2 kills in 1 demos" in claims[0].measured
    assert claim_of_everything([EQUAL], 0) is None


def test_a_demo_in_which_fewer_were_killed_than_asked_shows_nothing() -> None:
    in_peace, killed = replace(OFF, at=(), largest_difference=0.0), replace(OFF, largest_difference=0.0)
    held = [claim_of_everything(trials, 2) for trials in ([in_peace] * 20, [killed, in_peace], [killed, killed])]
    assert [claim is not None and claim.holds for claim in held] == [False, False, True]
    claim = claim_of_nodes([EQUAL, replace(EQUAL, killed="classifier", at=())])
    assert claim is not None and not claim.holds


def with_value(name: str, value: Any) -> HybridBelief:
    """A belief whose field of that name has this value."""
    return replace(believed(), **{name: value})


FLOATS = sorted(name for name, value in vars(believed()).items() if isinstance(value, float))


@pytest.mark.parametrize("name", FLOATS)
def test_a_number_that_one_run_does_not_know_differs_without_bound(name: str) -> None:
    known, unknown = with_value(name, 0.5), with_value(name, np.nan)
    assert largest_difference([unknown], [known]) == largest_difference([known], [unknown]) == np.inf
    assert largest_difference([unknown], [unknown]) == 0.0
    assert largest_difference([known], [with_value(name, 0.75)]) == 0.25


@pytest.mark.parametrize(
    ("ours", "theirs", "difference"),
    [
        (-np.inf, -np.inf, 0.0),
        (-np.inf, np.inf, np.inf),
        (-np.inf, np.nan, np.inf),
        (0.5, np.nan, np.inf),
        (np.nan, np.nan, 0.0),
        (0.5, 0.25, 0.25),
    ],
)
def test_numbers_of_arrays_are_compared_as_single_ones_are(ours: float, theirs: float, difference: float) -> None:
    own, other = (with_value("log_weights", np.array([-1.0, value])) for value in (ours, theirs))
    assert largest_difference([own], [other]) == difference
    assert largest_difference([own], [other], besides="log_weights") == 0.0


def test_no_beliefs_are_not_the_same_beliefs() -> None:
    assert largest_difference([], []) == np.inf > TOLERANCE


def test_a_difference_without_bound_is_kept_as_none(tmp_path: Path) -> None:
    trials = [EQUAL, replace(OFF, largest_difference=np.inf)]
    assert [trial.kept["largest_difference"] for trial in trials] == [0.0, None]
    assert trials[1].kept | {"largest_difference": np.inf} == asdict(trials[1])
    forged = Forged(num_messages=1, counted={}, refused={}, largest_difference=np.inf, findings=["beliefs differ"])
    write_forged(tmp_path, forged, seed=0)
    assert json.loads((tmp_path / "result.json").read_text())["largest_difference"] is None
