"""What some tests need that not every machine has: each function returns why they are skipped here, or nothing."""

import importlib.util
import os
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path

DATA = "SEMANTIC_SLAM_DATA"


@cache
def no_rendering() -> str:
    """The renderer's own reason when it cannot draw one small picture, because neither EGL nor OSMesa works."""
    from semantic_slam_lab.simulation.furniture import MODELS
    from semantic_slam_lab.simulation.mujoco_scene import PlacedObject, scene_xml
    from semantic_slam_lab.simulation.renderer import Renderer, RenderingError, camera_model

    placed = PlacedObject(1, "crate_1", next(iter(MODELS)), 0.0, 0.0, 0.0)
    try:
        with Renderer(*scene_xml([placed], None), camera_model(32, 24, 1.0)):
            return ""
    except RenderingError as fault:
        return str(fault)


def no_real_data() -> str:
    """Real data are licensed to be used, not to be shipped: where they lie, the environment says."""
    folder = os.environ.get(DATA, "")
    if not folder:
        return f"{DATA} is not set; name the folder of the real data sets with it"
    return "" if Path(folder).is_dir() else f"{DATA}={folder} is no folder"


def no_full_ros() -> str:
    """PyPI's wheels have rclpy and colcon, neither the command line nor launch."""
    if shutil.which("ros2") is None:
        return "no ros2 on PATH; source /opt/ros/jazzy/setup.bash before env.sh"
    missing = [name for name in ("launch_ros", "ros2bag") if importlib.util.find_spec(name) is None]
    return f"{', '.join(missing)} cannot be imported; apt-get install ros-jazzy-ros-base" if missing else ""


@cache
def no_network_namespaces() -> str:
    """Two hosts are two namespaces of the kernel, which not everybody may make."""
    missing = [name for name in ("ip", "nsenter") if shutil.which(name) is None]
    if missing:
        return f"no {' and no '.join(missing)} on PATH; apt-get install iproute2 util-linux"
    name = f"slam{os.getpid()}"
    made = subprocess.run(["ip", "netns", "add", name], check=False, capture_output=True)
    if made.returncode:
        return "network namespaces cannot be made here; run as root"
    subprocess.run(["ip", "netns", "delete", name], check=True, capture_output=True)
    return ""


PREREQUISITES: dict[str, Callable[[], str]] = {
    "render": no_rendering,
    "real_data": no_real_data,
    "ros_full": no_full_ros,
    "two_hosts": no_network_namespaces,
}
"""By the marker of the tests that need it."""
