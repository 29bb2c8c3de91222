"""The executables of the nodes, which say in one line where no ROS is sourced."""

import os
import signal
import sys
from importlib import import_module

from semantic_slam.cli.exit_codes import DONE, exit_code
from semantic_slam.cli.needs import need_ros


def bag_player() -> None:
    start("bag_player")


def bag_recorder() -> None:
    start("bag_recorder")


def classifier_node() -> None:
    start("classifier_node")


def hypothesis_manager_node() -> None:
    start("hypothesis_manager_node")


def backend_node() -> None:
    start("backend_node")


def start(name: str) -> None:
    """Run the node of the module ``name``, whose own ``main`` leaves the process with its exit code."""
    # A node that is ended has done what it was asked, though it has not begun yet: until it is being made there is
    # nothing to put in order, and an exception in the midst of an import turns into others.
    signal.signal(signal.SIGINT, lambda *_: os._exit(DONE))
    refused = exit_code(need_ros)
    if refused:
        sys.exit(refused)
    import_module(f"semantic_slam.ros.{name}").main()
