"""Entry points of the node executables; without a sourced ROS they print one line."""

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


def tf_odometry_node() -> None:
    start("tf_odometry_node")


def start(name: str) -> None:
    """Run the node of the module ``name``, whose own ``main`` exits with its exit code."""
    # An interrupt before the node is constructed ends the process at once and successfully: there is nothing to clean
    # up yet, and a KeyboardInterrupt during an import turns into other exceptions.
    signal.signal(signal.SIGINT, lambda *_: os._exit(DONE))
    refused = exit_code(need_ros)
    if refused:
        sys.exit(refused)
    import_module(f"semantic_slam.ros.{name}").main()
