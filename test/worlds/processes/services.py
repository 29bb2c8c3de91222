"""Calls of services of nodes in other processes."""

from typing import Any

import rclpy
from rclpy.node import Node

TIMEOUT_S = 180.0


def answered(node: Node, kind: Any, name: str, request: Any, tries: int = 3) -> Any:
    """The response to a request; it is repeated, as a reply is lost to a client not yet discovered by its server."""
    client = node.create_client(kind, name)
    try:
        assert client.wait_for_service(timeout_sec=TIMEOUT_S), name
        for _ in range(tries):
            future = client.call_async(request)
            rclpy.spin_until_future_complete(node, future, timeout_sec=TIMEOUT_S / tries)
            if future.done():
                return future.result()
        raise AssertionError(f"{name} does not answer")
    finally:
        node.destroy_client(client)
