"""The study of rooms with two instances of each class: which of two methods settles sooner."""

import pytest
from semantic_slam_lab.studies.latent_slam.study import MAPS, METHODS, METRICS, RoomResult, _claims


def rooms(latent: list[float | None], classes: list[float | None]) -> list[RoomResult]:
    """One room for each pair of keyframes from which on the association is settled; None: never."""

    def metrics(settled: float | None) -> dict[str, float | None]:
        return {**dict.fromkeys(METRICS, 1.0), "keyframe_disambiguated": settled}

    methods = [
        dict(zip(METHODS, map(metrics, (*pair, None)), strict=True)) for pair in zip(latent, classes, strict=True)
    ]
    return [RoomResult(n, 60, {told: own for told in MAPS}) for n, own in enumerate(methods)]


@pytest.mark.parametrize(
    ("latent", "classes", "holds"),
    [
        ([None] * 10, [1.0] * 9 + [None], False),  # both have a room that never settles, one has nothing else
        ([None] * 10, [None] * 10, False),
        ([1.0] * 10, [0.0] * 9 + [None], True),
        ([None] + [2.0] * 9, [None] + [1.0] * 9, False),
        ([None] + [1.0] * 9, [None] + [2.0] * 9, True),
    ],
)
def test_who_leaves_more_rooms_unsettled_settles_later(
    latent: list[float | None], classes: list[float | None], holds: bool
) -> None:
    claims = [claim for claim in _claims(rooms(latent, classes)) if "settle" in claim.text]
    assert len(claims) == 2 and all(claim.holds == holds for claim in claims), [claim.measured for claim in claims]
