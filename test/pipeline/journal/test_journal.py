"""A run whose manager is killed anywhere goes on from its journal, to the bit; what is torn or another's is told."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.same_beliefs import assert_same

from semantic_slam.configuration import Configuration, from_dict
from semantic_slam.errors import InputError, MessageError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import BackendPool, Candidates, Commit, Components
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.messages import topics
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.assembly.frame_count import FrameCount
from semantic_slam.pipeline.journal import segment
from semantic_slam.pipeline.journal.journal import Journal, NoJournal
from semantic_slam.pipeline.journal.journaled_pool import JournaledPool
from semantic_slam.pipeline.journal.segment import Record

PLACES = ((3.0, 0.5), (3.5, -0.6), (2.0, 1.0))
NUM_KEYFRAMES = 3
RUN = "this run"
CONFIGURATIONS = {
    "closed": from_dict({"semantic_model": {"kind": "none"}}),
    "open": from_dict(
        {
            "semantic_model": {"kind": "none"},
            "association": "open",
            "open_world": {"iterate_updates": False},
            "revision": {"every_keyframes": 1},
        }
    ),
    "open, labels and vectors": from_dict(
        {
            "semantic_model": {"kind": "detector_embedding", "labels": ["chair", "cup"]},
            "association": "open",
            "open_world": {"iterate_updates": False},
            "revision": {"every_keyframes": 1},
        }
    ),
}
LABELS, LOOKS = ("chair", "chair", "cup"), np.random.default_rng(0).normal(size=(len(PLACES), 8))
"""Of the things at these places; without class models they are not used."""


class KilledError(Exception):
    """The process is gone."""


class Mortal(InProcessPool):
    """Backends, and a manager that is killed when it has asked them so often."""

    def __init__(self, number: int, last_question: int) -> None:
        super().__init__(number)
        self.num_asked, self._last_question = 0, last_question

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        return self._asked(super().expand, keyframe)

    def commit(self, commit: Commit) -> list[Components]:
        return self._asked(super().commit, commit)

    def _asked(self, ask: Callable[[Any], list[Any]], question: Any) -> list[Any]:
        if self.num_asked == self._last_question:
            raise KilledError
        self.num_asked += 1
        return ask(question)


def keyframes() -> list[Keyframe]:
    things = list(zip(PLACES, LABELS, LOOKS, strict=True))
    return [
        Keyframe.planar(
            k,
            detections=[Detection.at(x - 0.1 * (k + 1), y, label=own, embedding=look) for (x, y), own, look in things],
            motion=(0.1, 0.0, 0.0),
        )
        for k in range(NUM_KEYFRAMES)
    ]


def drive(configuration: Configuration, pool: BackendPool) -> list[HybridBelief]:
    covariance = dict(sigma_m=0.1, sigma_rad=0.1)
    prior = MapPrior(tuple(ObjectPrior.planar(n, x, y, **covariance) for n, (x, y) in enumerate(PLACES)))
    run = make_run_configuration(configuration, prior, *initial_pose_of(configuration), stamp_ns=1)
    engine = Engine.of_run(run, pool)
    return [engine.process(keyframe) for keyframe in keyframes()]


def journal_in(folder: Path) -> Journal:
    """As a manager opens it."""
    return Journal(folder, RUN)


@pytest.mark.long
@pytest.mark.parametrize("name", CONFIGURATIONS)
@pytest.mark.parametrize("survive", [False, True])
def test_a_run_that_is_killed_between_any_two_rounds_goes_on_to_the_bit(
    name: str, survive: bool, tmp_path: Path
) -> None:
    """New backends know nothing but what they are told of keyframes; those that lived on go on."""
    configuration = CONFIGURATIONS[name]
    expected = drive(configuration, InProcessPool(2))
    first = Mortal(2, -1)
    drive(configuration, first)
    for question in range(first.num_asked):
        folder = tmp_path / str(question)
        pool = Mortal(2, question)
        with pytest.raises(KilledError):
            drive(configuration, JournaledPool(pool, journal := journal_in(folder)))
        journal.close()
        again = Surviving(pool) if survive else InProcessPool(2)
        beliefs = drive(configuration, JournaledPool(again, journal := journal_in(folder)))
        journal.close()
        for ours, theirs in zip(beliefs, expected, strict=True):
            assert_same(ours, theirs)


@pytest.mark.long
@pytest.mark.parametrize("name", CONFIGURATIONS)
@pytest.mark.parametrize("survive", [False, True])
def test_a_run_whose_journal_is_damaged_anywhere_goes_on_to_the_bit(name: str, survive: bool, tmp_path: Path) -> None:
    """Backends that lived on are ahead of what the journal still has, and go back."""
    configuration, whole = CONFIGURATIONS[name], tmp_path / "whole"
    expected = drive(configuration, InProcessPool(2))
    drive(configuration, JournaledPool(InProcessPool(2), journal := journal_in(whole)))
    journal.close()
    data = (whole / "journal").read_bytes()
    begins = ends_of_records(whole)
    assert len(begins) == 1 + 2 * NUM_KEYFRAMES
    for begin in begins[:-2]:
        folder = shutil.copytree(whole, tmp_path / f"{begin}")
        (folder / "journal").write_bytes(data[:begin] + bytes([data[begin] ^ 1]) + data[begin + 1 :])
        pool = Mortal(2, -1)
        drive(configuration, pool)
        again = Surviving(pool) if survive else InProcessPool(2)
        beliefs = drive(configuration, JournaledPool(again, journal := journal_in(folder)))
        assert journal.is_damaged
        journal.close()
        for ours, theirs in zip(beliefs, expected, strict=True):
            assert_same(ours, theirs)


def ends_of_records(folder: Path) -> list[int]:
    """Places in a journal's file behind each of its records."""
    file, ends = segment.Segment(folder / "journal"), []
    while file.read() is not None:
        ends.append(file.num_read)
    file.close()
    return ends


class Surviving(InProcessPool):
    """The backends of a manager that was killed, as another one finds them."""

    def __init__(self, pool: Mortal) -> None:
        self.backend_ids, self._backends = pool.backend_ids, pool._backends

    def start(self, run: object) -> None:
        """They know the run."""


def records(journal: NoJournal) -> list[Record]:
    taken = []
    while journal.next is not None:
        taken.append(journal.take())
    return taken


def filled(folder: Path) -> bytes:
    """The bytes of a journal of three records."""
    journal = journal_in(folder)
    for n in range(3):
        journal.append(topics.ODOMETRY, bytes([n]) * (10 + n))
    journal.sync()
    journal.close()
    return (folder / "journal").read_bytes()


def test_what_was_appended_is_there_again_and_goes_on(tmp_path: Path) -> None:
    filled(tmp_path)
    journal = journal_in(tmp_path)
    assert records(journal) == [Record(topics.ODOMETRY, bytes([n]) * (10 + n)) for n in range(3)]
    journal.append("more", b"x")
    journal.close()
    assert records(journal_in(tmp_path))[-1] == Record("more", b"x")


def test_a_torn_end_is_cut_off_with_one_line_wherever_it_is_torn(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = filled(tmp_path)
    last = 20 + len(topics.ODOMETRY) + 12
    for lost in range(1, last):
        (tmp_path / "journal").write_bytes(whole[:-lost])
        journal = journal_in(tmp_path)
        assert len(records(journal)) == 2
        journal.append("after", b"")
        journal.close()
        (line,) = capfd.readouterr().err.splitlines()
        assert f"its last {last - lost} bytes are torn" in line
        again = journal_in(tmp_path)
        assert [record.name for record in records(again)] == [topics.ODOMETRY] * 2 + ["after"]
        again.close()


def test_a_flipped_bit_is_noticed_and_nothing_whole_behind_it_is_deleted(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Only where no whole record follows was the end torn off; else the damaged file is kept, to the byte."""
    whole = filled(tmp_path)
    sizes = [20 + len(topics.ODOMETRY) + 10 + n for n in range(3)]
    begins = [len(whole) - sum(sizes[n:]) for n in range(3)]
    num_kept = 0
    for place in range(begins[0], len(whole)):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        (tmp_path / "journal").write_bytes(flipped)
        journal = journal_in(tmp_path)
        found = len(records(journal))
        assert found == sum(begin <= place for begin in begins) - 1
        assert (tmp_path / "journal").read_bytes() == whole[: begins[found]]
        said = capfd.readouterr().err
        if found == 2:
            assert f"its last {sizes[2]} bytes are torn; they are cut off" in said
        else:
            kept = tmp_path / f"journal.damaged_{num_kept:03}"
            num_kept += 1
            assert f"damaged at byte {begins[found]} of {len(whole)}; it is kept as {kept.name}" in said
            assert kept.read_bytes() == flipped
        journal.recovered(8)
        assert ("goes on from keyframe 7" in capfd.readouterr().err) == (found < 2)
        journal.append("after", b"")
        journal.close()
        again = journal_in(tmp_path)
        assert [record.name for record in records(again)] == [topics.ODOMETRY] * found + ["after"]
        again.close()
    assert num_kept == sum(sizes[:2]) == len(list(tmp_path.glob("journal.damaged_*")))


def test_records_are_found_behind_a_stretch_of_zeros_longer_than_what_is_searched_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(segment, "BLOCK", 37)
    journal = journal_in(tmp_path)
    for n in range(20):
        journal.append(topics.ODOMETRY, bytes([n]) * 50)
    journal.close()
    data = bytearray((tmp_path / "journal").read_bytes())
    data[300:1000] = bytes(700)
    (tmp_path / "journal").write_bytes(data)
    assert 0 < len(records(journal_in(tmp_path))) < 5
    assert "journal.damaged_000" in capfd.readouterr().err
    assert (tmp_path / "journal.damaged_000").read_bytes() == data


def test_a_damaged_journal_that_cannot_be_kept_is_not_touched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = bytearray(filled(tmp_path))
    data[len(data) // 2] ^= 1
    (tmp_path / "journal").write_bytes(data)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(InputError, match=r"is damaged, and cannot be kept as journal.damaged_000 \(No space left"):
        records(journal_in(tmp_path))
    assert (tmp_path / "journal").read_bytes() == data


def test_a_journal_of_another_run_or_of_a_living_process_is_refused_and_can_be_set_aside(tmp_path: Path) -> None:
    filled(tmp_path)
    with pytest.raises(InputError, match=r"is of another run .* name another journal, or set this one aside by"):
        Journal(tmp_path, "another run")
    journal = journal_in(tmp_path)
    with pytest.raises(InputError, match="another process goes on from it"):
        journal_in(tmp_path)
    journal.close()
    anew = Journal(tmp_path, "another run", resume=False)
    assert anew.next is None and (tmp_path / "journal.old").exists()


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"version": "0.3.0"}, r"\(its version is 0.2.0, not 0.3.0\)"),
        ({"source": "drive.mcap"}, r"\(its input is none, not drive.mcap\)"),
        ({"map_prior": "f00"}, r"\(its map differs\)"),
        ({"configuration": {"odometry": {"sigma": 2.0}, "pruning": {}}}, r"\(its configuration differs in odometry\)"),
        ({"map_prior": "f00", "version": "0.3"}, r"\(its map differs, its version is 0.2.0, not 0.3\)"),
    ],
)
def test_what_differs_between_a_journal_and_the_run_is_named(
    changes: dict[str, Any], told: str, tmp_path: Path
) -> None:
    run = {
        "configuration": {"odometry": {"sigma": 1.0}, "pruning": {}},
        "map_prior": "0ff",
        "source": "",
        "version": "0.2.0",
    }
    Journal(tmp_path, json.dumps(run)).close()
    with pytest.raises(InputError, match=told):
        Journal(tmp_path, json.dumps(run | changes))


def test_a_journal_that_does_not_fit_what_is_asked_is_refused(tmp_path: Path) -> None:
    journal = journal_in(tmp_path)
    journal.append(topics.COMPONENTS, b"\x00\x00\x00\x00")
    journal.close()
    with pytest.raises(InputError, match=r"in place of /hypothesis_manager/candidates of keyframe 0; remove it"):
        drive(CONFIGURATIONS["closed"], JournaledPool(InProcessPool(1), journal_in(tmp_path)))


def test_frames_and_drops_are_counted_once_when_a_classifier_begins_again() -> None:
    """Stamps 1..4 s with one drop each; the second classifier goes over the frames from 3 s on."""
    measurements = keyframes()[0].measurements

    def frame(second: int, sequence: int, dropped: int) -> SemanticMeasurements:
        return replace(measurements, stamp_ns=second * 10**9, sequence=sequence, dropped=dropped)

    count = FrameCount()
    told = [count.measured(frame(second, second - 1, second)) for second in (1, 2, 3, 4)]
    assert [one.dropped for one in told if one is not None] == [1, 2, 3, 4]
    count.lost(2)
    assert count.measured(frame(3, 0, 1)) is None and count.measured(frame(4, 1, 2)) is None
    after = count.measured(frame(5, 2, 3))
    assert after is not None and after.dropped == 5
    count.lost(0)
    count.lost(1)
    assert count.num_done(num_waiting=1) == 5 - 1 + 2 + 1


def test_who_starts_after_many_frames_were_lost_counts_the_next_ones_and_a_single_odd_number_changes_nothing() -> None:
    late = FrameCount()
    with pytest.raises(MessageError, match="were lost"):
        late.lost(5000)
    late.lost(5001)
    late.lost(5003)
    assert late.num_done(0) == 5003
    early = FrameCount()
    early.lost(3)
    with pytest.raises(MessageError, match="were lost"):
        early.lost(10**6)
    early.lost(4)
    with pytest.raises(MessageError, match="were lost"):
        early.lost(10**7)
    assert early.num_done(0) == 4


def test_frames_that_came_while_the_manager_was_down_are_counted_by_their_sequence_numbers() -> None:
    """Frames that are lost otherwise are counted where they are lost, so that none is counted twice."""
    measurements = keyframes()[0].measurements

    def frame(second: int, sequence: int) -> SemanticMeasurements:
        return replace(measurements, stamp_ns=second * 10**9, sequence=sequence)

    count = FrameCount()
    count.interrupted()  # the first start
    assert count.measured(frame(1, 0)) is not None and count.measured(frame(7, 6)) is not None
    assert not count.missed.total()
    count.interrupted()
    assert count.measured(frame(10, 9)) is not None and count.measured(frame(11, 10)) is not None
    assert dict(count.missed) == {"/classifier/measurements: came while the manager was down": 2}
    count.interrupted()  # another classifier meanwhile, of whose frames the first three were not heard
    assert count.measured(frame(20, 3)) is not None
    assert count.missed.total() == 2 + 3


def test_frames_that_came_before_a_live_manager_heard_any_are_counted_once() -> None:
    """Its classifier has measured four frames by then; in a later session it goes on with its numbers."""
    measurements = keyframes()[0].measurements

    def frame(second: int, sequence: int) -> SemanticMeasurements:
        return replace(measurements, stamp_ns=second * 10**9, sequence=sequence)

    early = {"/classifier/measurements: came before the manager heard any": 4}
    count = FrameCount()
    count.interrupted()  # the first start
    assert count.measured(frame(5, 4)) is not None and count.measured(frame(6, 5)) is not None
    assert dict(count.missed) == early
    another = count.anew()
    assert another.measured(frame(1, 6)) is not None
    assert not another.missed.total() and dict(count.missed) == early


def test_measurements_that_are_nobodys_are_refused_where_none_can_be_lost() -> None:
    """An earlier number, or a later one; a classifier that begins anew goes over the last frames."""
    measurements = keyframes()[0].measurements

    def frame(second: int, sequence: int) -> SemanticMeasurements:
        return replace(measurements, stamp_ns=second * 10**9, sequence=sequence)

    count = FrameCount(is_gapless=True)
    assert all(count.measured(frame(second, second + 2)) for second in (1, 2, 3))
    for strange in (frame(900, 3), frame(900, 0), frame(4, 7)):
        with pytest.raises(MessageError, match="somebody else"):
            count.measured(strange)
    assert count.measured(frame(3, 0)) is None and count.measured(frame(4, 1)) is not None
    with pytest.raises(MessageError, match="were lost"):
        count.lost(10**6)
    assert count.num_done(0) == 4
