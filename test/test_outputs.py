"""No command replaces what is not its own unasked, nor its own input, nor anything before the new one is whole."""

import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from worlds.bags.bag_factory import input_entries, write_bag, write_configuration
from worlds.processes import commands
from worlds.processes.node_runs import processes

from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import InputError
from semantic_slam.outputs import claimed, claimed_bag, claimed_file, claimed_folder, claimed_report, is_ours
from semantic_slam.ros.launching.node_set import NodeSpec

ROOT = Path(__file__).parents[1]
SHIPPED = ROOT / "bags" / "aliased_room"
REFUSAL = "exists already; give --overwrite to replace it, or name another output"
COMMANDS = {
    "import_dataset bag": ("import_dataset", "bag", str(SHIPPED)),
    "import_dataset avd": ("import_dataset", "avd", "anywhere"),
    "import_dataset bigbird": ("import_dataset", "bigbird", "anywhere"),
    "import_dataset victoria_park": ("import_dataset", "victoria_park"),
    "bag_to_report": ("bag_to_report", str(SHIPPED)),
    "bench": ("bench", "--quick"),
    "run_study": ("run_study", "ch4_example", "--quick"),
    "train_classifier": ("train_classifier", "--turntables", "anywhere"),
    "train_latent_model": ("train_latent_model", "--turntables", "anywhere"),
    "fit_viewpoint_models": ("fit_viewpoint_models", "--turntables", "anywhere"),
    "demo": ("demo", "--bag", str(SHIPPED), "--config", str(ROOT / "config" / "default.yaml")),
}


PACKAGES = {"demo": "semantic_slam.ros"} | dict.fromkeys(
    ("bench", "run_study", "make_scene"), "semantic_slam_lab.commands"
)


def call(folder: Path, command: str, *words: object) -> commands.Result:
    return commands.call(folder, f"{PACKAGES.get(command, 'semantic_slam.cli')}.{command}", *words)


def digest(path: Path) -> dict[str, str]:
    """Every file below a path by its content."""
    files = sorted(item for item in path.rglob("*") if item.is_file()) if path.is_dir() else [path]
    return {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("source") / "recording", input_entries(12))


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_asks_before_it_replaces(name: str, tmp_path: Path) -> None:
    is_bag = name.startswith("import_dataset")
    mine = write_bag(tmp_path / "mine", input_entries(1)) if is_bag else tmp_path / "mine.safetensors"
    if name in ("bag_to_report", "run_study", "demo"):
        mine = tmp_path / "mine"
        mine.mkdir()
        (mine / "objects.json").write_text("my map")
    elif not is_bag:
        mine.write_text("hours of training")
    before = digest(mine)
    command, *words = COMMANDS[name]
    result = call(tmp_path, command, *words, "--out", mine)
    assert result.returncode == 2
    assert result.stderr.splitlines() == [f"{mine}: {REFUSAL}"]
    assert digest(mine) == before
    assert os.listdir(tmp_path) == [mine.name]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "existing"),
    [
        ((), "Gen_000_1"),
        (("--standing",), "standing.objects.json"),
        (("--turntable",), "classes.json"),
    ],
)
def test_make_scene_asks_for_what_it_would_replace_and_not_for_its_neighbours(
    tmp_path: Path, words: tuple[str, ...], existing: str
) -> None:
    (tmp_path / existing).write_text("mine")
    (tmp_path / "neighbour").write_text("mine, too")
    result = call(tmp_path, "make_scene", *words, "--out", tmp_path)
    assert (result.returncode, result.stderr.splitlines()) == (2, [f"{tmp_path / existing}: {REFUSAL}"])


@pytest.mark.slow
@pytest.mark.parametrize("words", [(), ("--overwrite",)])
@pytest.mark.parametrize("where", ["itself", "a link to it", "above it", "inside it"])
def test_an_output_is_never_the_input(recording: Path, tmp_path: Path, where: str, words: tuple[str, ...]) -> None:
    link = tmp_path / "link"
    link.symlink_to(recording)
    out = {"itself": recording, "a link to it": link, "above it": recording.parent, "inside it": recording / "x"}[where]
    before = digest(recording)
    for command in (("import_dataset", "bag", recording), ("bag_to_report", recording)):
        result = call(tmp_path, *map(str, command), "--out", out, *words)
        assert result.returncode == 2
        (line,) = result.stderr.splitlines()
        assert line.startswith(f"{out}: ") and "an input of this command; name another output" in line
    assert digest(recording) == before


def test_a_report_never_takes_the_place_of_the_map_that_it_was_given(recording: Path, tmp_path: Path) -> None:
    old = tmp_path / "old"
    old.mkdir()
    prior = old / "objects.json"
    prior.write_bytes((recording / "objects.json").read_bytes())
    result = call(tmp_path, "bag_to_report", recording, "--map-prior", prior, "--out", old, "--overwrite")
    assert result.returncode == 2 and "an input of this command" in result.stderr


@pytest.mark.slow
def test_with_leave_a_report_replaces_its_own_files_and_no_others(recording: Path, tmp_path: Path) -> None:
    configuration = write_configuration(tmp_path / "configuration")
    out = tmp_path / "mine"
    out.mkdir()
    (out / "report.json").write_text("old")
    (out / "thesis.tex").write_text("years of work")
    result = call(tmp_path, "bag_to_report", recording, "--config", configuration, "--out", out, "--overwrite")
    assert result.returncode == 0
    assert (out / "report.json").read_text().startswith("{")
    assert (out / "thesis.tex").read_text() == "years of work"
    assert str(out / "report.html") in result.stdout.splitlines()
    names = {"belief", "objects.json", "report.html", "report.json", "thesis.tex", "trajectory.tum"}
    assert set(os.listdir(out)) == names
    with BagReader(out / "belief") as reader:
        assert reader.num_messages and not reader.damage


@pytest.mark.slow
def test_with_leave_a_bag_is_replaced_as_a_whole(recording: Path, tmp_path: Path) -> None:
    old = write_bag(tmp_path / "old", input_entries(1))
    result = call(tmp_path, "import_dataset", "bag", recording, "--out", old, "--overwrite")
    assert result.returncode == 0, result.stderr
    assert not (old / "objects.json").exists()
    with BagReader(old) as reader:
        assert reader.counts["/detections"] == 12
    assert os.listdir(tmp_path) == ["old"]


@pytest.mark.slow
def test_below_out_commands_repeat_without_leave(recording: Path, tmp_path: Path) -> None:
    for _ in range(2):
        assert call(tmp_path, "import_dataset", "bag", recording, "--out", "out/bag").returncode == 0
    assert os.listdir(tmp_path / "out") == ["bag"]


def test_a_link_below_out_does_not_make_what_it_names_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "link").symlink_to(tmp_path / "mine")
    assert is_ours(Path("out/report"))
    assert not is_ours(Path("out")) and not is_ours(Path("out/link")) and not is_ours(Path("out/../mine"))


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_or_killed_command_leaves_the_old_output(tmp_path: Path, ending: signal.Signals) -> None:
    old = tmp_path / "mine"
    old.mkdir()
    for name in ("report.json", "objects.json"):
        (old / name).write_text("old")
    line = "from semantic_slam.cli.bag_to_report import main; main()"
    words = [sys.executable, "-c", line, str(SHIPPED), "--out", str(old), "--overwrite"]
    process = subprocess.Popen(
        words,
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # whoever runs tests may ignore it
    )
    give_up = time.monotonic() + 120.0
    while not list(old.glob("*.unfinished_*/mine/belief/*.mcap")):
        assert process.poll() is None and time.monotonic() < give_up
        time.sleep(0.02)
    time.sleep(0.2)
    process.send_signal(ending)
    process.communicate(timeout=60)
    assert process.returncode == (130 if ending == signal.SIGINT else -signal.SIGKILL)
    assert {(old / name).read_text() for name in ("report.json", "objects.json")} == {"old"}
    assert not (old / "belief").exists()
    if ending == signal.SIGINT:
        assert sorted(os.listdir(old)) == ["objects.json", "report.json"]


@pytest.mark.slow
def test_bad_input_leaves_nothing_so_that_the_corrected_command_needs_no_leave(tmp_path: Path, recording: Path) -> None:
    result = call(tmp_path, "bag_to_report", recording, "--map-prior", "nowhere.json", "--out", "mine")
    assert result.returncode == 2
    assert not (tmp_path / "mine").exists()


def test_a_fault_in_between_puts_the_old_one_back(tmp_path: Path) -> None:
    old = tmp_path / "model"
    old.write_text("old")
    with pytest.raises(RuntimeError), claimed(old, (), overwrite=True) as new:
        new.write_text("half of the n")
        raise RuntimeError
    assert old.read_text() == "old" and os.listdir(tmp_path) == ["model"]
    with claimed(old, (), overwrite=True) as new:
        new.write_text("new")
        assert old.read_text() == "old"
    assert old.read_text() == "new" and os.listdir(tmp_path) == ["model"]


def test_a_folder_is_not_replaced_by_a_file_even_with_leave(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text("mine")
    with pytest.raises(InputError, match="is a folder; name a file"), claimed_file(tmp_path, overwrite=True):
        pass
    assert (tmp_path / "report.json").read_text() == "mine"


def test_a_pipe_is_not_replaced_by_a_file_even_with_leave(tmp_path: Path) -> None:
    os.mkfifo(pipe := tmp_path / "pipe")
    with pytest.raises(InputError, match="is a pipe or a device; name a file"), claimed_file(pipe, overwrite=True):
        pass
    assert pipe.is_fifo()


def test_what_is_no_bag_is_not_replaced_by_one_even_with_leave(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="no part of a bag"), claimed_bag(tmp_path, (), overwrite=True):
        pass
    with pytest.raises(InputError, match="is a file"), claimed_folder(tmp_path / "thesis.tex", (), overwrite=True):
        pass


def foreign(bag: Path) -> Path:
    """The bag as another software would have written it."""
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("written_by: semantic_slam", "robot: mine"))
    return bag


def test_a_recording_of_another_software_is_not_replaced_even_with_leave(recording: Path, tmp_path: Path) -> None:
    mine = foreign(write_bag(tmp_path / "mine", input_entries(1)))
    before = digest(mine)
    result = call(tmp_path, "import_dataset", "bag", recording, "--out", mine, "--overwrite")
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"{mine}: its metadata do not say that semantic_slam wrote it, so it is not replaced")
    assert digest(mine) == before
    (mine / "metadata.yaml").unlink()
    with pytest.raises(InputError, match="it is not replaced"), claimed_bag(mine, (), overwrite=True):
        pass


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda folder: write_bag(folder, input_entries(1)), "holds a bag"),
        (lambda folder: foreign(write_bag(folder / "belief", input_entries(1))), "it is not replaced"),
        (lambda folder: (folder.mkdir(), (folder / "objects.json").write_text("map")), "that is of no report"),
    ],
)
def test_a_report_does_not_replace_what_no_report_wrote_even_with_leave(
    tmp_path: Path, make: Callable[[Path], object], reason: str
) -> None:
    out = tmp_path / "mine"
    make(out)
    before = digest(out)
    with pytest.raises(InputError, match=reason), claimed_report(out, (), overwrite=True):
        pass
    assert digest(out) == before


def test_a_report_may_replace_an_older_report_with_leave(tmp_path: Path) -> None:
    out = tmp_path / "mine"
    write_bag(out / "belief", input_entries(1))
    (out / "report.json").write_text("old")
    (out / "objects.json").write_text("old")
    with claimed_report(out, (), overwrite=True) as staged:
        (staged / "objects.json").write_text("new")
    assert (out / "objects.json").read_text() == "new"


@pytest.mark.ros
@pytest.mark.slow
def test_the_recorder_asks_and_with_leave_keeps_the_old_bag_until_it_is_done(tmp_path: Path) -> None:
    old = write_bag(tmp_path / "old", input_entries(1))
    before = digest(old)
    with processes(tmp_path) as nodes:
        nodes.start(NodeSpec("bag_recorder", "bag_recorder", {"bag": str(old)}))
        while (code := nodes.exit_code("bag_recorder")) is None:
            time.sleep(0.05)
        assert code == 2
        assert f"{old}: exists already; give overwrite:=true to replace it" in nodes.tail("bag_recorder")
    with processes(tmp_path) as nodes:
        nodes.start(NodeSpec("bag_recorder", "bag_recorder", {"bag": str(old), "overwrite": True}))
        while ": ready" not in nodes.tail("bag_recorder"):
            nodes.check()
            time.sleep(0.05)
        assert list(tmp_path.glob("old.unfinished_*/old/*.mcap"))
        assert digest(old) == before
    assert digest(old) == before  # nothing was recorded
    assert sorted(os.listdir(tmp_path)) == ["log", "old"]
