"""Every test run has its own ROS domain, on this machine only, with rclpy's field checks on."""

import os

import pytest
from prerequisites import PREREQUISITES

DOMAINS = 100

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % DOMAINS)
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"

pytest.register_assert_rewrite("contracts", "worlds")  # so that their assertions show both sides when they fail


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what this machine cannot run, before fixtures try, and say what is missing."""
    for marker, reason in PREREQUISITES.items():
        if item.get_closest_marker(marker) and (missing := reason()):
            pytest.skip(missing)
