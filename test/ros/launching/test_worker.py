"""The thread that processes a node's messages."""

import threading

from semantic_slam.ros.node.worker import Worker


def test_a_call_that_waits_for_others_is_told_that_the_node_ends() -> None:
    worker, waits, ended = Worker(lambda _: None), threading.Event(), threading.Event()

    def wait(_: None) -> None:
        waits.set()
        while not worker.is_ending:
            threading.Event().wait(0.01)
        ended.set()

    worker.submit(wait, None)
    worker.start()
    assert waits.wait(60.0) and not worker.is_ending
    worker.stop()
    assert ended.wait(60.0)
