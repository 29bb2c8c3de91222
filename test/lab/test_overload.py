"""What is said of live nodes that are sent more than they can use."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest
from semantic_slam_lab.fuzz.answers import believed
from semantic_slam_lab.overload import listener
from semantic_slam_lab.overload.outcome import SETTLED, Row, check_seconds, claims_of

from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode


def rows(latest_s: float, resident_mb: Sequence[float], counted: int) -> list[Row]:
    """A row per thousand keyframes and hundred seconds, and so many counted as dropped of a thousand that were.

    The newest belief comes in time at each row, and the latest one between two rows late by ``latest_s``.
    """
    return [
        Row(100.0 * n, 2000 * n + 1, SETTLED * n, 0.1, latest_s, counted * n, {"backend_0": memory})
        for n, memory in enumerate(resident_mb, start=1)
    ]


@pytest.mark.parametrize(
    ("latest_s", "resident_mb", "counted", "holds"),
    [
        (9.9, (200.0, 201.0, 202.0, 203.0), 1000, [True, True, True]),
        (10.1, (200.0, 201.0, 202.0, 203.0), 1000, [False, True, True]),
        (9.9, (200.0, 201.0, 202.0, 203.0), 999, [True, False, True]),
        (9.9, (200.0, 220.0, 240.0, 260.0), 1000, [True, True, False]),
    ],
)
def test_overload_holds_where_delay_and_memory_stay_and_drops_are_counted(
    latest_s: float, resident_mb: Sequence[float], counted: int, holds: list[bool]
) -> None:
    assert [claim.holds for claim in claims_of(rows(latest_s, resident_mb, counted))] == holds


def test_an_estimator_that_is_stuck_shows_no_small_delay() -> None:
    """Beliefs end at the third row; whatever is sent from then on is counted as dropped."""
    alive = rows(0.1, [200.0] * 6, 1000)
    stuck = [replace(row, keyframe=alive[2].keyframe, dropped=row.sent - SETTLED * 3 - 1) for row in alive[3:]]
    claims = claims_of(alive[:3] + stuck)
    assert [claim.holds for claim in claims] == [False, True, True]
    assert claims[0].measured == "none from 300 to 400 s"


def test_too_short_a_run_is_refused_before_it_begins_and_too_few_rows_after_it() -> None:
    for too_short in (10.0, float("nan")):
        with pytest.raises(InputError, match=r"--seconds .*; give at least 15"):
            check_seconds(too_short)
    check_seconds(15.0)
    for count in (0, 1):
        with pytest.raises(InputError, match=f"{count} rows.*; give a greater --seconds"):
            claims_of(rows(0.1, [200.0] * count, 1000))


def test_the_latest_belief_since_the_last_row_is_told_though_the_newest_one_is_in_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hears: dict[str, Callable[[bytes], None]] = {}
    monkeypatch.setattr(listener, "receive", lambda node, topic, callback, profile: hears.update({topic: callback}))
    own = listener.Listener(None)
    for keyframe, late_s in enumerate((1.0, 7.0, 2.0)):
        stamp_ns = time.time_ns() - int(late_s * 1e9)
        hears[topics.BELIEF](encode(replace(believed(), keyframe=keyframe, stamp_ns=stamp_ns)))
    assert own.keyframe == 2 and own.late_s == pytest.approx(2.0, abs=1.0)
    assert own.take_latest_s() == pytest.approx(7.0, abs=1.0)
    assert own.take_latest_s() == 0.0
