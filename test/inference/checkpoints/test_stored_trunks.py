"""A backend that is started again goes on from a file, to the bit, and believes no file that is not its own."""

import os
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.soak.robots import robot
from semantic_slam_lab.soak.tour import Tour

from semantic_slam.inference.backend import Backend
from semantic_slam.inference.checkpoints import stored_trunks
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.hypotheses import redistributed
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.trunks import MOST
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.lineage import next_id
from semantic_slam.run_folder import RunFolder

HORIZON, KEYFRAMES = 20, 28
APART = HORIZON // 4


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def keyframes(count: int = KEYFRAMES) -> list[Keyframe]:
    return [seen.keyframe for seen in islice(Tour(robot("given")).keyframes(), count)]


def undisturbed(told: list[Keyframe]) -> tuple[Engine, Backend]:
    """A run of one backend that stores its checkpoints."""
    engine = Engine(robot("given", HORIZON))
    backend = Backend(0, stores_checkpoints=True)
    backend.start(engine.run)
    engine.pool._backends[:] = [backend]  # type: ignore[attr-defined]
    for keyframe in told:
        engine.process(keyframe)
    return engine, backend


def otherwise() -> list[Keyframe]:
    """The keyframes, one of which has another motion."""
    changed = keyframes()
    changed[3] = replace(changed[3], odometry=changed[3].odometry + 1e-9 * np.eye(7)[0])
    return changed


def informed(engine: Engine, told: list[Keyframe]) -> Backend:
    """A new backend of the run that knows these keyframes."""
    backend = Backend(0, stores_checkpoints=True)
    backend.start(engine.run)
    for keyframe in told:
        backend.learn(keyframe)
    return backend


def started_again(engine: Engine) -> Backend:
    """A new backend that is given what the first one held."""
    backend, last = informed(engine, keyframes()), engine.hypotheses.num_keyframes - 1
    backend.commit(engine.hypotheses.commit(engine.run.run_id, last, engine.live, always_lineage=True))
    return backend


def found(engine: Engine, told: list[Keyframe]) -> tuple[int, Component] | None:
    """The deepest checkpoint of a new backend along the lineage of the run's hypothesis."""
    backend, numbers = informed(engine, told), [ROOT_ID]
    (own,) = engine.live.values()
    for stamp_ns, step in zip(backend.steps.stamps_ns, own.lineage, strict=True):
        numbers.append(next_id(numbers[-1], stamp_ns, step))
    return backend.trunks.deepest(numbers)


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.checkpoint"))


def assert_equal(one: Component, other: Component) -> None:
    ours, theirs = one.smoother.isam, other.smoother.isam
    assert np.array_equal(ours.getDelta().vector(), theirs.getDelta().vector())
    assert ours.getLinearizationPoint().serialize() == theirs.getLinearizationPoint().serialize()
    assert np.array_equal(one.path(), other.path())


@pytest.mark.long
def test_a_backend_that_is_started_again_replays_what_came_after_the_newest_file_to_the_bit(folder: Path) -> None:
    engine, first = undisturbed(keyframes())
    assert [path.name[:9] for path in files(folder)] == ["000000025"]
    again = started_again(engine)
    assert (again.num_rebuilt, again.num_replayed) == (1, KEYFRAMES - 25)
    (number,) = again.held
    assert_equal(again.held[number].component, first.held[number].component)
    assert not again.trunks.faults


def test_another_backend_of_the_host_takes_a_component_over_from_a_file(folder: Path) -> None:
    engine, first = undisturbed(keyframes())
    other, last = Backend(1, stores_checkpoints=True), engine.hypotheses.num_keyframes - 1
    other.start(engine.run)
    for keyframe in keyframes():
        other.learn(keyframe)
    moved = redistributed(engine.live, [1])
    other.commit(engine.hypotheses.commit(engine.run.run_id, last, moved, always_lineage=True))
    (number,) = other.held
    assert other.num_replayed == KEYFRAMES - 25
    assert_equal(other.held[number].component, first.held[number].component)


def flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.long
@pytest.mark.parametrize("spoil", [flipped, cut, emptied])
def test_a_damaged_file_is_not_believed_but_counted_and_made_anew(folder: Path, spoil: Callable[[Path], None]) -> None:
    engine, first = undisturbed(keyframes())
    (path,) = files(folder)
    whole = path.read_bytes()
    spoil(path)
    again = started_again(engine)
    assert again.num_replayed == KEYFRAMES
    assert again.trunks.faults == {"a damaged file": 1}
    assert path.read_bytes() == whole
    (number,) = again.held
    assert_equal(again.held[number].component, first.held[number].component)


def test_a_file_of_another_version_or_of_other_keyframes_is_not_found(monkeypatch: pytest.MonkeyPatch) -> None:
    engine, _ = undisturbed(keyframes())
    assert found(engine, otherwise()) is None
    stored = found(engine, keyframes())
    assert stored is not None and stored[0] == 25
    monkeypatch.setattr(stored_trunks, "VERSIONS", ("another",))
    assert found(engine, keyframes()) is None


@pytest.mark.long
def test_a_file_under_the_name_of_another_is_not_believed(folder: Path) -> None:
    engine, _ = undisturbed(keyframes())
    (path,) = files(folder)
    undisturbed(otherwise())
    (other,) = set(files(folder)) - {path}
    other.replace(path)
    again = started_again(engine)
    assert again.trunks.faults == {"a damaged file": 1} and again.num_replayed == KEYFRAMES


@pytest.mark.long
def test_files_are_bounded_and_removed_by_the_last_node_of_the_run(folder: Path) -> None:
    engine, first = undisturbed(keyframes(HORIZON + (MOST + 2) * APART))
    assert len(files(folder)) == MOST
    other = informed(engine, [])
    first.trunks.close()
    assert len(files(folder)) == MOST
    other.trunks.close()
    assert not list(folder.rglob("*.checkpoint")) and not list((folder / f"semantic_slam_{os.getuid()}").iterdir())


@pytest.mark.long
def test_a_run_removes_what_a_killed_one_has_left(folder: Path) -> None:
    _, first = undisturbed(keyframes())
    assert isinstance(first.trunks, stored_trunks.StoredTrunks) and first.trunks.folder._descriptor is not None
    os.close(first.trunks.folder._descriptor)  # as the system does
    RunFolder("another").leave()
    assert not files(folder)


@pytest.mark.long
def test_a_folder_that_others_may_write_to_is_not_used(folder: Path) -> None:
    (folder / f"semantic_slam_{os.getuid()}").mkdir(mode=0o777)
    os.chmod(folder / f"semantic_slam_{os.getuid()}", 0o777)
    _, backend = undisturbed(keyframes())
    assert not files(folder)
    ((reason, _),) = backend.trunks.faults.items()
    assert "not private" in reason
