"""What nodes say of themselves tells which robot they are of."""

from types import SimpleNamespace

import pytest

from semantic_slam.messages.node_status import HARDWARE_ID, is_of_another_robot, is_ours, status_name


@pytest.mark.parametrize(
    ("node", "namespace"), [("/classifier", "/"), ("/robot1/classifier", "/robot1"), ("/a/b/classifier", "/a/b")]
)
def test_a_status_is_of_the_namespace_of_its_node(node: str, namespace: str) -> None:
    status = SimpleNamespace(hardware_id=HARDWARE_ID, name=status_name(node, "input /other/odom"))
    assert is_ours(status, namespace) and not is_of_another_robot([status], namespace)
    assert not is_ours(status, "/robot2") and is_of_another_robot([status], "/robot2")


def test_what_others_say_is_of_no_robot() -> None:
    status = SimpleNamespace(hardware_id="camera 7", name="robot2/camera: temperature")
    assert not is_ours(status, "/") and not is_of_another_robot([status], "/robot1")
