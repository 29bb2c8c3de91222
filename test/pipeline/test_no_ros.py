"""Everything below the nodes imports and works where no ROS is installed."""

import subprocess
import sys

import pytest

WITHOUT_ROS = """
import importlib, pkgutil, sys
for name in ("rclpy", "std_msgs", "semantic_slam_msgs", "ament_index_python"):
    sys.modules[name] = None  # an import of it raises ImportError
import semantic_slam
for module in pkgutil.walk_packages(semantic_slam.__path__, "semantic_slam."):
    if not module.name.startswith("semantic_slam.ros"):
        print(importlib.import_module(module.name).__name__)
"""


@pytest.mark.long
@pytest.mark.slow
def test_the_rooms_below_ros_import_without_it():
    result = subprocess.run([sys.executable, "-c", WITHOUT_ROS], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    imported = result.stdout.split()
    assert {"semantic_slam.inference.engine", "semantic_slam.pipeline.offline"} <= set(imported)
    assert "semantic_slam.inference.smoothing.component" in imported  # rooms within rooms are entered
