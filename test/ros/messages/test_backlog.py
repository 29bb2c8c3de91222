"""Of messages that come faster than they are worked on the newest wait, and the others are told apart."""

from semantic_slam.ros.node.backlog import Backlog


def test_the_oldest_go_and_as_many_wait_as_may() -> None:
    backlog = Backlog(3)
    assert [backlog.add(bytes([n])) for n in range(5)] == [False, False, False, True, True]
    assert [backlog.take() for _ in range(3)] == [b"\x02", b"\x03", b"\x04"]
    assert not backlog.add(b"")
