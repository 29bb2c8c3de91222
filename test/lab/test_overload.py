"""What is said of live nodes that are sent more than they can use."""

from collections.abc import Sequence

import pytest
from semantic_slam_lab.overload.outcome import SETTLED, Row, claims_of


def rows(late_s: float, resident_mb: Sequence[float], counted: int) -> list[Row]:
    """A row per thousand keyframes and hundred seconds, and so many counted as dropped of a thousand that were."""
    return [
        Row(100.0 * n, 2000 * n, SETTLED * n, late_s, counted * n, {"backend_0": memory})
        for n, memory in enumerate(resident_mb, start=1)
    ]


@pytest.mark.parametrize(
    ("late_s", "resident_mb", "counted", "holds"),
    [
        (9.9, (200.0, 201.0, 202.0, 203.0), 999, [True, True, True]),
        (10.1, (200.0, 201.0, 202.0, 203.0), 999, [False, True, True]),
        (9.9, (200.0, 201.0, 202.0, 203.0), 900, [True, False, True]),
        (9.9, (200.0, 220.0, 240.0, 260.0), 999, [True, True, False]),
    ],
)
def test_overload_holds_where_delay_and_memory_stay_and_drops_are_counted(
    late_s: float, resident_mb: Sequence[float], counted: int, holds: list[bool]
) -> None:
    assert [claim.holds for claim in claims_of(rows(late_s, resident_mb, counted))] == holds
