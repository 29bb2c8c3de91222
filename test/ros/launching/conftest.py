"""Launch files without ``launch``, which is not everywhere.

The stand-ins only note what they are called with; what real ``ros2 launch`` makes of it is for a ROS machine.
"""

import runpy
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]
ACTIONS = "semantic_slam.ros.launching.launch_actions"


def noted(kind: str) -> Any:
    """A class whose instances remember their arguments."""
    return lambda *arguments, **options: SimpleNamespace(kind=kind, arguments=arguments, **options)


@pytest.fixture
def load_launch_file(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], dict[str, Any]]]:
    """The names of a launch file of this name, with stand-ins for the packages that are not installed here."""
    kinds = ("DeclareLaunchArgument", "EmitEvent", "LogInfo", "OpaqueFunction", "Shutdown", "TimerAction")
    actions = {kind: noted(kind) for kind in kinds}
    contents = {
        "launch": {"LaunchDescription": list},
        "launch.actions": actions,
        "launch.events": {"matches_action": lambda action: action},
        "launch.events.process": {"SignalProcess": noted("SignalProcess")},
        "launch.substitutions": {"LaunchConfiguration": lambda name: SimpleNamespace(perform=lambda c: c[name])},
        "launch_ros": {},
        "launch_ros.actions": {"Node": lambda **options: noted("Node")(process_details={"pid": 1}, **options)},
    }
    for name, members in contents.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, ACTIONS, raising=False)
    yield lambda name: runpy.run_path(str(ROOT / "launch" / name))
    sys.modules.pop(ACTIONS, None)  # it holds the stand-ins
