"""README and docs say what is there: code runs, commands, files, sections and numbers exist."""

import ast
import re
import runpy
import sys
from pathlib import Path

import pytest
from worlds.processes.installed import declared

from semantic_slam.configuration import Configuration, to_dict

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "CHANGELOG.md",
        *sorted((ROOT / "docs").glob("*.md")),
    )
}
MOST_LINES = 150
FOLDERS = "semantic_slam|lab|test|config|docs|bags|launch|msg_defs|examples|requirements"
YOURS = {"config/mine.yaml", "bags/mine", "bags/mine/objects.json", "bags/mine.mcap", "bags/mine.objects.json"}
"""Files that the reader is told to make."""
OUTSIDE = {"python", "python3", "pip", "make", "source", "ros2", "colcon", "rviz2", "git", "mkdocs", "cd", "pre-commit"}
"""Commands that are not ours."""
FORMER = {"semantic_model.correlated_views", "open_world.settle"}
"""Older names of parameters, which the changelog tells."""
each_page = pytest.mark.parametrize("name", PAGES)


def blocks(text: str, language: str) -> list[str]:
    """Fenced code of one language."""
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def slugs(text: str) -> set[str]:
    """Anchors of a page's headings."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def commands_of(block: str) -> list[list[str]]:
    """Words of each command of a shell block, continued lines joined, comments left out."""
    lines = block.replace("\\\n", " ").splitlines()
    parts = [part for line in lines for part in re.sub(r"(^|\s)#.*", "", line).split("&&")]
    return [words for part in parts if (words := part.split())]


def test_readme_is_of_one_screen_or_two() -> None:
    assert len(README.splitlines()) <= MOST_LINES


@pytest.mark.slow
def test_python_in_the_readme_runs_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first = next(block for block in blocks(README, "python") if "rclpy" not in block)
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    monkeypatch.chdir(tmp_path)
    exec(compile(first, "README.md", "exec"), {"__name__": "__main__"})
    *objects, weights = capsys.readouterr().out.splitlines()
    assert len(objects) == 2 and all("exists: " in line for line in objects)
    assert sum(map(float, weights.strip("[]").split(","))) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["README.md", "docs/ros.md"])
def test_the_ros_example_in_the_docs_is_the_one_that_runs_with_the_nodes(name: str) -> None:
    example = (ROOT / "examples" / "print_belief.py").read_text(encoding="utf-8").partition('"""\n\n')[2]
    assert example in blocks(PAGES[name], "python")


@pytest.mark.parametrize("name", ["docs/own_classes.md", "docs/python.md"])
def test_what_python_in_the_docs_imports_exists(name: str) -> None:
    parts = [part for block in blocks(PAGES[name], "python") for part in ast.parse(block).body]
    imports = [part for part in parts if isinstance(part, ast.Import | ast.ImportFrom)]
    exec(compile(ast.Module(imports, type_ignores=[]), name, "exec"), {})


@pytest.mark.long
@pytest.mark.slow
def test_the_offline_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(
        sys, "argv", ["examples/offline.py", "bags/aliased_room", str(tmp_path / "belief"), "--max-keyframes", "5"]
    )
    runpy.run_path("examples/offline.py", run_name="__main__")
    told = capsys.readouterr().out.splitlines()
    assert told[-9] == "5 keyframes, dropped: {}"
    assert told[-8].startswith("object_1 {'cabinet': ")


@each_page
def test_links_lead_somewhere(name: str) -> None:
    text, folder = PAGES[name], (ROOT / name).parent
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if link.startswith("http"):
            continue
        path, _, anchor = link.partition("#")
        target = (folder / path).resolve() if path else ROOT / name
        assert target.exists(), link
        if anchor:
            assert anchor in slugs(target.read_text(encoding="utf-8")), link


@each_page
def test_files_it_names_exist(name: str) -> None:
    named = set(re.findall(rf"`((?:{FOLDERS})/[\w./-]+)`", PAGES[name])) - YOURS
    assert [path for path in sorted(named) if not (ROOT / path).exists()] == []


@each_page
def test_commands_it_names_are_installed(name: str) -> None:
    installed = {line.split("=")[0].strip() for line in declared(ROOT).entry_points["console_scripts"]}
    found = [words for block in blocks(PAGES[name], "bash") for words in commands_of(block)]
    unknown = {words[0] for words in found} - installed - OUTSIDE
    assert {word for word in unknown if "=" not in word and not word.startswith(("./", "."))} == set()


@each_page
def test_make_targets_it_names_exist(name: str) -> None:
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert set(re.findall(r"`make ([a-z]+)\b", PAGES[name])) <= targets


@each_page
def test_parameters_it_names_exist(name: str) -> None:
    groups = {key: values for key, values in to_dict(Configuration()).items() if isinstance(values, dict)}
    known = {f"{group}.{key}" for group, values in groups.items() for key in values} | FORMER
    named = set(re.findall(rf"`((?:{'|'.join(groups)})\.\w+)(?:[:`])", PAGES[name]))
    assert named <= known


def test_symbols_of_the_theory_are_in_the_files_beside_them() -> None:
    rows = [line.strip("| ").split(" | ") for line in PAGES["docs/theory.md"].splitlines() if line.startswith("| ")]
    found = [(re.findall(r"`(\w+)`", row[2]), re.findall(r"`([\w/.]+\.py)`", row[3])) for row in rows if len(row) == 4]
    pairs = [(name, files) for names, files in found for name in names]
    assert len(pairs) > 30
    texts = {file: (ROOT / file).read_text(encoding="utf-8") for _, files in pairs for file in files}
    missing = [name for name, files in pairs if not any(re.search(rf"\b{name}\b", texts[file]) for file in files)]
    assert missing == []
