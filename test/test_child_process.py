"""A process beside this one that is lost."""

import pytest

from semantic_slam.child_process import ChildProcess
from semantic_slam.errors import SemanticSlamError


def test_a_process_that_ends_in_the_midst_of_a_message_is_named_with_a_remedy() -> None:
    child = ChildProcess("the one beside", "worlds.half_a_message")
    with pytest.raises(SemanticSlamError, match=r"the one beside ended with exit code 0; .*--processes 1"):
        child.receive()
    child.end(at_once=False)
