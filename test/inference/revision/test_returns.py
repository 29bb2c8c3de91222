"""A return that was taken for another one: what was pruned there comes back, with the weight that it would have had."""

import numpy as np
import pytest
from worlds.drives.drifted_return import open_world

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.geometry import se2
from semantic_slam.inference.revision.replay import Progress, Replay
from semantic_slam.inference.revision.returns.returns import Returns
from semantic_slam.inference.revision.returns.run_model import RunModel
from semantic_slam.inference.revision.returns.runs import Runs, numbered
from semantic_slam.inference.revision.returns.solution import solved
from semantic_slam.inference.revision.returns.whole_drive import WholeDrive
from semantic_slam.inference.states.lineage import Lineage

SIGMAS = np.array([0.05, 0.02])
SLIP = np.array([1.0, 0.3, 0.0])
"""What odometry does not tell of the way back: the second post then stands where the first one should."""
POSTS = np.array([[3.0, 1.0], [4.0, 1.3], [5.0, -2.0]])
AWAY, BACK = np.array([-20.0, 0.0, 0.0]), np.array([20.0, 0.0, 0.0])
SHOWN = [[0, 2]] * 3 + [[]] * 7 + [[1]] + [[0, 1, 2]] * 3
"""Posts that each frame shows: away for seven keyframes, and back with a view of the second post alone."""


def configuration(revision: dict[str, int], **others: object) -> Configuration:
    return open_world(revision, {"merge_position_m": 0.0}, **others)


def keyframes() -> list[Keyframe]:
    """Without noise: only the slip is wrong."""
    found, robot = [], np.zeros(3)
    for k, shown in enumerate(SHOWN):
        motion, sigmas = np.zeros(3), (1e-3,) * 3
        if k == 3:
            motion, sigmas = AWAY, (1e-2, 1e-2, 1e-3)
        if k == 10:
            motion, sigmas = BACK, (1.0, 1.0, 0.05)
            robot = se2.compose(robot, SLIP)
        robot = se2.compose(robot, motion)
        points = [se2.between(robot, np.array([*POSTS[n], 0.0]))[:2] for n in shown]
        polar = [(float(np.hypot(*p)), float(np.arctan2(p[1], p[0]))) for p in points]
        detections = [Detection(range_m=r, bearing_rad=b, covariance=np.diag(SIGMAS**2)) for r, b in polar]
        found.append(Keyframe.planar(k, motion=motion, motion_sigmas=sigmas, detections=detections))
    return found


def driven(revision: dict[str, int], backends: int = 1, **others: object) -> Engine:
    engine = Engine(configuration(revision, **others), initial_covariance=np.diag([1e-6] * 3), backends=backends)
    for keyframe in keyframes():
        engine.process(keyframe)
    return engine


def joints(engine: Engine) -> dict[int, float]:
    """Hypothesis id -> log P(history, Z)."""
    return {number: live.log_weight + engine.log_evidence for number, live in engine.live.items()}


def objects_of(engine: Engine) -> list[tuple[int, ...]]:
    """What the best history takes the detections of each frame for."""
    return [step.association for step in next(iter(engine.live.values())).lineage]


ONE = {"pruning": {"max_hypotheses": 1}}
TRUE = [(0, 1)] * 3 + [()] * 7 + [(6,)] + [(0, 6, 1)] * 3


def test_what_was_pruned_at_a_return_comes_back_by_a_split_and_the_joins_that_follow() -> None:
    engine = driven({"every_keyframes": 14}, **ONE)
    assert objects_of(engine) == TRUE


def test_without_splits_it_does_not() -> None:
    engine = driven({"every_keyframes": 1, "splits": 0}, **ONE)
    assert objects_of(engine)[10] == (0,)
    assert len({number for own in objects_of(engine) for number in own}) > len(POSTS)


@pytest.mark.long
def test_a_split_history_weighs_what_it_weighs_when_all_are_followed() -> None:
    found = joints(driven({"every_keyframes": 14}, **ONE))
    wide = {"pruning": {"max_hypotheses": 100, "ratio": 1e12}, "weights": {"max_candidates": 60}}
    followed = joints(driven({}, **wide))
    assert max(followed, key=lambda number: followed[number]) in found
    for number, log_joint in found.items():
        assert log_joint == pytest.approx(followed[number], abs=1e-9)


def test_a_history_that_is_live_already_is_not_added_twice() -> None:
    engine = driven({"every_keyframes": 1}, pruning={"max_hypotheses": 40})
    assert objects_of(engine) == TRUE
    lineages = [live.lineage for live in engine.live.values()]
    assert len(set(lineages)) == len(lineages)


@pytest.mark.long
def test_split_histories_are_those_of_any_number_of_backends() -> None:
    one, two = (driven({"every_keyframes": 3}, number, pruning={"max_hypotheses": 10}) for number in (1, 2))
    assert joints(one) == joints(two)


@pytest.fixture(scope="module")
def lost() -> tuple[WholeDrive, Runs, np.ndarray, Replay, Lineage]:
    """The drive as one problem, with the runs of the history that took one post for the other."""
    engine = driven({"every_keyframes": 50}, **ONE)
    lineage = next(iter(engine.live.values())).lineage
    (held,) = engine.pool._backends[0].held.values()
    standing = [np.ones(len(step.association), dtype=bool) for step in lineage]
    drive = WholeDrive.of(engine.problem, held.component, engine.steps, standing)
    objects = numbered(np.array([number for step in lineage for number in step.association]))
    runs = Runs.of(objects, drive.keyframes, 0, len(engine.steps))
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry), engine.steps)
    assert held.component.tracked is not None
    path = np.concatenate([np.zeros((1, 3)), held.component.tracked.trail])
    return drive, runs, path, replay, lineage


def test_unions_of_runs_weigh_what_they_weigh_when_each_is_solved(
    lost: tuple[WholeDrive, Runs, np.ndarray, Replay, Lineage],
) -> None:
    drive, runs, path, *_ = lost
    first = solved(drive, runs.objects[runs.detections], path)
    model = RunModel.at(drive, runs, first, runs.objects)
    assert model.log_evidence(runs.objects) == pytest.approx(first.log_evidence, abs=0.05)
    apart = np.arange(len(runs.objects))
    alone = solved(drive, apart[runs.detections], path)
    at_alone = RunModel.at(drive, runs, alone, apart)
    assert at_alone.log_evidence(apart) == pytest.approx(alone.log_evidence, abs=1e-3)
    assert at_alone.log_evidence(runs.objects) == pytest.approx(first.log_evidence, abs=0.5)


def test_a_drive_solved_at_once_is_where_its_history_has_it(
    lost: tuple[WholeDrive, Runs, np.ndarray, Replay, Lineage],
) -> None:
    drive, runs, path, replay, lineage = lost
    followed = replay.followed(lineage)
    assert followed is not None
    assert followed.component.tracked is not None
    found = solved(drive, runs.objects[runs.detections], path)
    np.testing.assert_allclose(found.path[-1], followed.component.tracked.robot, atol=0.01)
    np.testing.assert_allclose(found.places, followed.component.tracked.states[:, :2], atol=0.01)


def test_errors_that_repeat_have_the_variance_that_detections_state() -> None:
    errors = {"correlated_share": 0.9}
    engine = driven({"every_keyframes": 50}, detection_errors=errors, **ONE)
    (held,) = engine.pool._backends[0].held.values()
    lineage = next(iter(engine.live.values())).lineage
    standing = [np.ones(len(step.association), dtype=bool) for step in lineage]
    drive = WholeDrive.of(engine.problem, held.component, engine.steps, standing)
    covariance = np.linalg.inv(drive.information)
    np.testing.assert_allclose(np.diagonal(covariance), 1.0, atol=1e-6)
    assert covariance[0, 4] == pytest.approx(0.9, abs=0.02)  # of the ranges of one post in two frames at rest


def test_a_return_parts_what_follows_it_or_one_run_alone() -> None:
    keyframes = np.array([0, 1, 9, 9, 20, 21])
    runs = Runs.of(np.array([0, 0, 0, 1, 0, 1]), keyframes, 0, 22)
    assert runs.objects.tolist() == [0, 0, 0, 1, 1]
    assert runs.keyframes.tolist() == [0, 9, 20, 9, 21]
    parted = [parting.objects.tolist() for parting in runs.partings()]
    assert parted == [[0, 2, 2, 1, 1], [0, 2, 0, 1, 1], [0, 0, 2, 1, 1], [0, 0, 0, 1, 2]]


def test_beginnings_up_to_a_return_are_proposed_besides_the_histories() -> None:
    """The robot came back at keyframe 10: what it has seen since is taken anew."""
    engine = driven({"every_keyframes": 50}, **ONE)
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry), engine.steps)
    followed = replay.followed(next(iter(engine.live.values())).lineage)
    assert followed is not None
    histories = Returns(engine.problem.revision, replay, engine.registry, 30).histories(followed, 1000.0)
    whole, beginnings = histories[: len(histories) // 2], histories[len(histories) // 2 :]
    assert whole
    assert [own[: len(begun)] for own, begun in zip(whole, beginnings, strict=True)] == beginnings
    assert {len(begun) for begun in beginnings} == {11}


def test_a_history_that_is_followed_again_goes_on_from_where_it_stood(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every keyframe of it is replayed once, and the weight is that of a replay from the start."""
    engine = driven({"every_keyframes": 50}, **ONE)
    lineage = next(iter(engine.live.values())).lineage
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry))
    replayed = list[int]()
    advance = Replay.advanced

    def counted(self: Replay, own: Progress, count: int, *, in_place: bool = True) -> Progress:
        replayed.append(own.at)
        return advance(self, own, count, in_place=in_place)

    monkeypatch.setattr(Replay, "advanced", counted)
    for count, step in enumerate(engine.steps, start=1):
        replay.steps.append(step)
        before = replay.before(lineage, count - 1)
        followed = replay.followed(lineage[:count])
        assert before is not None and followed is not None
    assert replayed == list(range(len(engine.steps)))
    whole = Replay(engine.problem, engine.association(engine.problem, engine.registry), engine.steps).followed(lineage)
    assert whole is not None and followed.log_joint == whole.log_joint
