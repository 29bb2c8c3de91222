"""Rooms that a study draws by its seed: none for two seeds, and one that never settles counts."""

from importlib import import_module
from pathlib import Path

import pytest
from semantic_slam_lab.studies.aliased_room.scenes import METRICS, SETTLED, SceneResult, _means

STUDIES = {
    "aliased_room.scenes": 1,
    "carried_robot.study": 2,
    "desks.study": 0,
    "embeddings.study": 2,
    "faulty_rooms.study": 2,
    "latent_slam.study": 1,
    "tables.study": 0,
}
"""Module -> which argument of its tasks is the room."""


class AskedError(Exception):
    """Tasks that a study would run."""


def asked(function: object, tasks: list[tuple[object, ...]], jobs: int, description: str) -> None:
    raise AskedError(tasks)


@pytest.mark.parametrize(("module", "place"), STUDIES.items())
def test_two_seeds_share_no_room(module: str, place: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    study = import_module(f"semantic_slam_lab.studies.{module}")
    monkeypatch.setattr(study, "repeat", asked)
    monkeypatch.delenv("SEMANTIC_SLAM_DATA", raising=False)
    rooms = []
    for seed in (0, 1):
        with pytest.raises(AskedError) as found:
            study.run(tmp_path, quick=False, jobs=1, seed=seed)
        rooms.append({task[place] for task in found.value.args[0]})
    first, second = rooms
    assert len(first) == len(second) >= 3 and not first & second
    assert min(first) in (0, 1) and max(first) - min(first) == len(first) - 1


def test_a_room_that_never_settles_counts_as_the_keyframe_after_its_last() -> None:
    def metrics(settled: float | None) -> dict[str, float | None]:
        return {**dict.fromkeys(METRICS, 0.5), "min_true_class_probability": None, SETTLED: settled}

    results = [SceneResult(n, 60, metrics(2.0 if n else None), {}, {}, {}) for n in range(10)]
    means = _means(results, lambda result: result.ours)
    assert means[SETTLED] == pytest.approx((9 * 2.0 + 60) / 10)
    assert means["ate_m"] == 0.5 and means["min_true_class_probability"] is None
