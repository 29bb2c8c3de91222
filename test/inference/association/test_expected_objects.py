"""Which objects of a large map a keyframe is about when a history is followed again."""

from semantic_slam.inference.association.closed_world import FEW_OBJECTS, expected_along
from semantic_slam.inference.states.lineage import LineageStep

MANY = list(range(10, 11 + FEW_OBJECTS))


def test_along_a_path_they_are_those_of_the_path() -> None:
    assert expected_along(LineageStep((12, -1, 10), (0, -1, 0)), MANY) == [10, 12]


def test_where_all_detections_are_of_nothing_there_is_still_one() -> None:
    assert expected_along(LineageStep((-1, -1), (-1, -1)), MANY) == MANY[:1]


def test_few_objects_and_no_path_leave_all() -> None:
    path = LineageStep((-1,), (-1,))
    assert expected_along(path, MANY[:2]) == MANY[:2]
    assert expected_along(None, MANY) == MANY
