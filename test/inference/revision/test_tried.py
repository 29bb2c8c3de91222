"""What is tried again, and when."""

from semantic_slam.inference.revision.tried import Tried
from semantic_slam.inference.states.lineage import Lineage, LineageStep

PAIR = (0, 1)


def lineage_of(*frames: tuple[int, ...]) -> Lineage:
    """A history whose frames show these objects."""
    return tuple(LineageStep(association=own, class_assignment=(-1,) * len(own), mode=0) for own in frames)


def test_a_pair_is_tried_again_after_a_while_when_one_of_it_was_seen_since() -> None:
    tried = Tried(patience=3)
    first = lineage_of((0, 1))
    assert tried.news([PAIR], first) == [PAIR]
    tried.note([PAIR], len(first))
    assert not tried.news([PAIR], first)
    assert not tried.news([PAIR], lineage_of((0, 1), (1,), (2,)))
    assert tried.news([PAIR], lineage_of((0, 1), (1,), (2,), (2,))) == [PAIR]
    assert not tried.news([PAIR], lineage_of((0, 1), (2,), (2,), (2,), (2,)))


def test_other_groups_of_the_same_objects_are_news() -> None:
    tried = Tried(patience=3)
    tried.note([PAIR], 1)
    assert tried.news([PAIR, (0, 2), (0, 1, 2)], lineage_of((0, 1, 2))) == [(0, 2), (0, 1, 2)]
