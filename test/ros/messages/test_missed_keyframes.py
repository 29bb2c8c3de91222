"""A backend that is started in the middle of a run is told what it has missed, a stretch at a time."""

from collections import Counter
from typing import Any

import pytest
from worlds.same_beliefs import assert_same
from worlds.scenes.three_places import CLOSED, OPEN, drive

from semantic_slam.configuration import Configuration
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates, Commit, Components, MissedKeyframes, RunConfiguration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, encode
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.ros.rounds import missed
from semantic_slam.ros.rounds.missed import MissedQuestions
from semantic_slam.ros.rounds.work_order import WorkOrder

NUM_KEYFRAMES = 9


class Restarting:
    """A backend that is another process from some messages on, which knows nothing; bytes reach who is there alone."""

    backend_ids = (0,)

    def __init__(self, *restarts: tuple[str, int]) -> None:
        self.told: list[int] = []  # keyframes that were told again
        self.refused, self.repeated = Counter[str](), Counter[str]()
        self._restarts = set(restarts)
        self._questions = MissedQuestions(self.backend_ids, self.refused, self.repeated)

    def start(self, run: RunConfiguration) -> None:
        self._run, self._kept = run, KeptRun(run)
        self._begin()

    def _begin(self) -> None:
        self.order = WorkOrder(lambda: Backend(0))
        self.order.take(encode(self._run), topics.TYPES[topics.RUN_CONFIGURATION])

    def begin(self, keyframe: Keyframe) -> None:
        pass

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        self._kept.add(keyframe)
        data = encode(keyframe, run_id=self._run.run_id)
        return self._ask(topics.KEYFRAMES, keyframe.index, data)

    def commit(self, commit: Commit) -> list[Components]:
        return self._ask(topics.COMMITS, commit.keyframe, encode(commit))

    def offer(self, components: Any) -> None:
        pass

    def _ask(self, topic: str, index: int, data: bytes) -> list[Any]:
        if (topic, index) in self._restarts:
            self._restarts.remove((topic, index))
            self._begin()
        kind = Candidates if topic == topics.KEYFRAMES else Components
        self._answers = self.order.take(data, topics.TYPES[topic])
        for _ in range(NUM_KEYFRAMES):
            own = [answer for answer in self._answers if isinstance(answer, kind) and answer.keyframe == index]
            if own:
                return own
            for answer in self._answers:
                if isinstance(answer, MissedKeyframes):
                    self._questions.ask(encode(answer))
            self._answers = []
            knows_all = self._questions.answer(self._run.run_id, self._kept, index + 1, self)  # type: ignore[arg-type]
            if knows_all and kind is Components:
                self._answers += self.order.take(data, topics.TYPES[topic])
        raise AssertionError(f"no answer to {topic} of keyframe {index}")

    def send(self, data: bytes) -> None:
        self.told.append(decode(data, topics.TYPES[topics.KEYFRAMES]).index)
        self._answers += self.order.take(data, topics.TYPES[topics.KEYFRAMES])


@pytest.mark.long
@pytest.mark.parametrize("configuration", [CLOSED, OPEN])
@pytest.mark.parametrize("restart", [(topics.KEYFRAMES, 7), (topics.COMMITS, 7), (topics.KEYFRAMES, 1)])
def test_a_restarted_backend_asks_until_it_knows_all_keyframes_and_no_belief_changes(
    configuration: Configuration, restart: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(missed, "MOST_TOLD", 3)
    expected = drive(configuration, InProcessPool(1), NUM_KEYFRAMES)
    pool = Restarting(restart)
    for ours, theirs in zip(drive(configuration, pool, NUM_KEYFRAMES), expected, strict=True):
        assert_same(ours, theirs)
    newest = restart[1]
    assert pool.told == {1: [0, 1], 7: [0, 1, 2, 7, 3, 4, 5, 7, 6, 7]}[newest]
    assert pool.repeated == {topics.MISSED: 1 + newest // 3} and not pool.refused


def test_questions_that_nobody_of_the_run_can_ask_are_counted_and_not_answered() -> None:
    pool = Restarting()
    drive(CLOSED, pool, 2)
    run_id = pool._run.run_id
    for number, question in enumerate(
        (
            encode(MissedKeyframes(run_id="another's", backend_id=0, keyframe=0)),
            encode(MissedKeyframes(run_id=run_id, backend_id=77, keyframe=0)),
            encode(MissedKeyframes(run_id=run_id, backend_id=0, keyframe=3)),
            b"\x00\x01\x00\x00\xff\xff\xff\xff",
        ),
        start=1,
    ):
        pool._questions.ask(question)
        assert not pool._questions.answer(run_id, pool._kept, 2, pool)  # type: ignore[arg-type]
        assert pool.refused.total() == number and not pool.told
    assert set(pool.refused) >= {
        f"{topics.MISSED}: {reason}"
        for reason in ("of another run", "of a backend that there is not", "of a keyframe that there is not yet")
    }
