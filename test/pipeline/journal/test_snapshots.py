"""A run with a horizon goes on from a snapshot and what came since, to the bit, whenever its manager was killed."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from semantic_slam_lab.soak.journaled_manager import Event, KeepingPool, LivingPool, Manager, events_of
from semantic_slam_lab.soak.robots import robot
from semantic_slam_lab.soak.tour import Tour
from worlds.same_beliefs import assert_same
from worlds.scenes.labelled_looks import by_labels_and_vectors, with_labels_and_vectors

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.checkpoints.records import packed
from semantic_slam.pipeline.journal.journal import FILE, NEXT_FILE

HORIZON, NUM_KEYFRAMES, KILLED_AT = 20, 55, 47


def configuration_of(name: str) -> Configuration:
    """A robot of the tours; none that is carried, so that no history is replayed from its start."""
    own = robot(name, HORIZON)
    weights = replace(own.weights, max_history=HORIZON // 2)
    return replace(own, weights=weights, revision=replace(own.revision, carried_probability=0.0))


@dataclass(frozen=True)
class Run:
    """A run that is not disturbed, and the files of one that was killed."""

    configuration: Configuration
    events: list[Event]
    beliefs: dict[int, HybridBelief]
    state: bytes  # of the session at the end
    killed_at: int  # events
    folder: Path
    pool: KeepingPool

    def goes_on(self, folder: Path, pool: KeepingPool | None = None) -> Manager:
        """Another manager, which handles the rest of the events; its beliefs and its state must be the same."""
        manager = Manager(folder, self.configuration, pool)
        for event in self.events[self.killed_at :]:
            manager.receive(event)
        for keyframe, belief in manager.beliefs.items():
            assert_same(belief, self.beliefs[keyframe])
        assert list(manager.beliefs)[-1] == list(self.beliefs)[-1]
        assert packed(manager.session.state()) == self.state
        return manager


@pytest.fixture(scope="module", params=["given", "open", "open, labels and vectors"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    name, *seen = request.param.split(", ")
    configuration = configuration_of(name)
    tour = Tour(configuration).keyframes()
    keyframes = [next(tour).keyframe for _ in range(NUM_KEYFRAMES)]
    if seen:
        configuration = by_labels_and_vectors(configuration)
        keyframes = [with_labels_and_vectors(keyframe) for keyframe in keyframes]
    events = list(events_of(keyframes))
    folder, killed_at = tmp_path_factory.mktemp("killed"), KILLED_AT * len(events) // NUM_KEYFRAMES
    killed = Manager(folder, configuration)
    for event in events[:killed_at]:
        killed.receive(event)
    killed.close()
    undisturbed = Manager(tmp_path_factory.mktemp("undisturbed"), configuration)
    for event in events:
        undisturbed.receive(event)
    state = packed(undisturbed.session.state())
    return Run(configuration, events, undisturbed.beliefs, state, killed_at, folder, killed.pool)


@pytest.mark.long
def test_new_backends_rebuild_what_a_snapshot_has(run: Run, tmp_path: Path) -> None:
    """Twice: the second manager takes another snapshot, from which a third one goes on."""
    folder = shutil.copytree(run.folder, tmp_path / "copy")
    manager = run.goes_on(folder)
    assert min(manager.beliefs) == HORIZON and manager.num_replayed < run.killed_at - 3 * HORIZON // 2
    manager.close()
    again = Manager(folder, run.configuration)
    assert packed(again.session.state()) == run.state


def test_backends_that_lived_on_keep_what_they_hold(run: Run, tmp_path: Path) -> None:
    """Checked last of the two, as it uses up the backends."""
    run.goes_on(shutil.copytree(run.folder, tmp_path / "copy"), LivingPool(run.pool))


def test_the_newer_snapshot_is_enough_where_the_older_file_is_damaged(
    run: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(run.folder, tmp_path / "copy")
    data = bytearray((folder / FILE).read_bytes())
    data[len(data) // 2] ^= 1
    (folder / FILE).write_bytes(data)
    manager = run.goes_on(folder)
    assert min(manager.beliefs) == 2 * HORIZON
    assert "the run goes on from journal.next alone" in capfd.readouterr().err


def test_a_snapshot_of_another_version_is_one_line_with_the_remedy(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = shutil.copytree(run.folder, tmp_path / "copy")
    monkeypatch.setattr(Manager, "STATE", ("frames", "pool"))
    with pytest.raises(
        InputError, match=r"no journal of this version \(no state of Manager\); remove it and run again"
    ):
        Manager(folder, run.configuration)


def test_where_no_snapshot_can_be_taken_the_journal_goes_on_and_says_so(run: Run, tmp_path: Path) -> None:
    """A folder in the place of the new file stands for a disk that takes none."""
    manager = Manager(tmp_path / "own", run.configuration)
    (tmp_path / "own" / "journal.new").mkdir()
    for event in run.events[: 4 * HORIZON]:
        manager.receive(event)
    assert manager.snapshots.fault == "the journal grows on, as no snapshot could be taken (Is a directory)"
    assert not (tmp_path / "own" / NEXT_FILE).exists()


def test_without_a_horizon_there_are_no_snapshots(tmp_path: Path) -> None:
    configuration = robot("given")
    tour = Tour(configuration).keyframes()
    manager = Manager(tmp_path, configuration)
    for event in events_of([next(tour).keyframe for _ in range(HORIZON + 5)]):
        manager.receive(event)
    assert {path.name for path in tmp_path.iterdir()} == {"journal", "journal.lock"}
