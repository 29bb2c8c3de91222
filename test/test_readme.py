"""The README says what is there: its example is the one that is tested, its links and commands exist."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["print_belief.py", "offline.py"])
def test_examples_are_the_tested_ones(name: str) -> None:
    assert (ROOT / "examples" / name).read_text(encoding="utf-8").strip() in README


@pytest.mark.slow
def test_the_offline_example_runs(tmp_path: Path) -> None:
    command = [sys.executable, "examples/offline.py", "bags/aliased_room", str(tmp_path / "belief")]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    assert told[-9] == "5 keyframes, dropped: {}"
    assert told[-8].startswith("object_1 {'cabinet': ")


def test_links_lead_somewhere() -> None:
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", README) if not link.startswith("http")]
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_sections_it_leads_to_exist_and_nothing_is_left_to_fill_in() -> None:
    headings = re.findall(r"^#+ (.+)$", README, re.MULTILINE)
    slugs = {re.sub(r"[^a-z0-9 -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    assert set(re.findall(r"\]\(#([^)]+)\)", README)) <= slugs
    assert not re.search(r"@[A-Z]+@|<!-- (\w+) -->\s*<!-- end of", README)


def test_every_command_is_installed() -> None:
    installed = set(re.findall(r'"(\w+)"', (ROOT / "setup.py").read_text(encoding="utf-8")))
    blocks = re.findall(r"```bash\n(.*?)```", README, re.DOTALL)
    words = {line.split()[0] for block in blocks for line in block.splitlines() if line.strip()}
    ours = {word for word in words if "_" in word and "/" not in word}
    assert ours and ours <= installed


def test_configurations_it_names_exist() -> None:
    named = set(re.findall(r"config/\w+\.(?:yaml|rviz)", README)) - {"config/mine.yaml"}
    assert named and all((ROOT / name).is_file() for name in named)
