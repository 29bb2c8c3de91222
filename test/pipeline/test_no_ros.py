"""Everything below the nodes imports and works where no ROS is installed."""

import subprocess
import sys

WITHOUT_ROS = """
import importlib, pkgutil, sys
for name in ("rclpy", "std_msgs", "semantic_slam_msgs", "ament_index_python"):
    sys.modules[name] = None  # an import of it raises ImportError
import semantic_slam
for room in ("bag", "geometry", "inference", "messages", "perception", "pipeline", "report", "viewpoint"):
    package = importlib.import_module(f"semantic_slam.{room}")
    for module in pkgutil.iter_modules(package.__path__):
        print(importlib.import_module(f"{package.__name__}.{module.name}").__name__)
"""


def test_the_rooms_below_ros_import_without_it():
    result = subprocess.run([sys.executable, "-c", WITHOUT_ROS], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr
    assert "semantic_slam.inference.engine" in result.stdout
    assert "semantic_slam.pipeline.offline" in result.stdout
