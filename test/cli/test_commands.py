"""One command with sub-commands: each explains itself under the name that it was called by."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from semantic_slam.cli.commands import COMMANDS, Command, Group, main
from semantic_slam.cli.import_dataset import FORMATS

HEAVY = ("numpy", "scipy", "torch", "gtsam", "cv2", "rosbags", "rclpy", "matplotlib", "yaml", "jinja2")
LEFT_OVER = f"""
import sys
from semantic_slam.cli.commands import main
sys.argv = ["semantic_slam", *sys.argv[1:]]
try:
    main()
finally:
    print(*(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)
"""


def paths(group: Group) -> list[str]:
    """All commands of a group, with the words that lead to them."""
    found = []
    for name, command in group.commands.items():
        found += [name] if isinstance(command, Command) else [f"{name} {inner}" for inner in paths(command)]
    return found


def call(monkeypatch: pytest.MonkeyPatch, *words: str, program: str = "/anywhere/bin/semantic_slam") -> int:
    monkeypatch.setattr(sys, "argv", [program, *words])
    with pytest.raises(SystemExit) as left:
        main()
    assert isinstance(left.value.code, int)
    return left.value.code


@pytest.mark.parametrize("path", paths(COMMANDS))
def test_every_command_explains_itself(
    path: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, *path.split(), "--help") == 0
    assert capsys.readouterr().out.startswith(f"usage: semantic_slam {path} ")


@pytest.mark.parametrize(
    "path", ["report", "import avd", "train latent", "fit", "find", "study", "scene", "demo", "view"]
)
def test_nothing_heavy_is_imported_before_the_arguments_are_understood(path: str) -> None:
    words = [sys.executable, "-c", LEFT_OVER, *path.split(), "--no-such-option"]
    told = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert told.returncode == 2
    line, left_over = told.stderr.splitlines()
    assert line.startswith(f"semantic_slam {path}")
    assert path == "import avd" or left_over == ""  # a format declares its own arguments


def test_the_list_has_a_line_for_every_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, "--help") == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line[0] for line in lines if line and line[0] in COMMANDS.commands] == list(COMMANDS.commands)
    assert all(len(line) > 2 for line in lines if line and line[0] in COMMANDS.commands)


@pytest.mark.parametrize("words", [(), ("frobnicate",), ("train",), ("train", "frobnicate"), ("report",)])
def test_wrong_usage_is_one_line_with_a_remedy(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("semantic_slam") and "--help tells what is possible" in line


@pytest.mark.parametrize(
    ("alias", "command"),
    [("bag_to_report", "report"), ("import_dataset", "import"), ("train_latent_model", "train latent")],
)
def test_an_alias_is_the_command_under_another_name(
    alias: str, command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, *command.split(), "--help") == 0
    expected = capsys.readouterr().out.replace(f"semantic_slam {command}", alias)
    monkeypatch.setattr(sys, "argv", [f"/anywhere/bin/{alias}", "--help"])
    with pytest.raises(SystemExit):
        import_module(f"semantic_slam.cli.{alias}").main()
    assert capsys.readouterr().out.split() == expected.split()  # apart from where lines break


def test_without_ros_the_view_says_in_one_line_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("semantic_slam.cli.needs.find_spec", lambda name: None)
    assert call(monkeypatch, "view") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("semantic_slam view: needs rclpy, not found here; source ROS 2")


def test_the_table_of_commands_names_every_import_format() -> None:
    page = (Path(__file__).parents[2] / "docs" / "install.md").read_text(encoding="utf-8")
    assert f"`semantic_slam import {{{','.join(FORMATS)}}} " in page
