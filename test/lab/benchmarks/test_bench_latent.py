"""The latent benchmarks time what they say they time."""

import gtsam
import numpy as np
import pytest
from semantic_slam_lab.benchmarks import latent_drive, latent_update
from semantic_slam_lab.benchmarks.latent_drive import Drive
from semantic_slam_lab.benchmarks.latent_update import Circuit, measured
from worlds.views.harmonic_model import HarmonicModel

from semantic_slam.geometry.pose import planar_from_pose_vector

MODEL = HarmonicModel()
POSES = 20


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(latent_update, "POSES", POSES)
    monkeypatch.setattr(latent_drive, "POSES", POSES)
    monkeypatch.setattr(latent_drive, "MEASURED", 3)


def size(isam: gtsam.ISAM2) -> int:
    graph = gtsam.NonlinearFactorGraph(isam.getFactorsUnsafe())
    return sum(graph.exists(i) for i in range(graph.size()))


def test_both_sides_update_by_as_many_factors() -> None:
    circuit = Circuit(MODEL, 0)
    added = []
    for latent, plain in ((True, 1), (False, 2)):
        isam = circuit.grown(POSES, latent=latent)
        before = size(isam)
        isam.update(*circuit.keyframe(POSES, latent=latent, plain=plain))
        added.append(size(isam) - before)
    assert added == [7, 7]
    kinds = {type(factor) for factor in circuit.linear(*circuit.views(POSES))}
    assert kinds == {gtsam.LinearContainerFactor}


def test_rows_have_the_agreed_names() -> None:
    rows = [*measured(MODEL, 2, 0), *latent_drive.driven(MODEL, 0)]
    assert [row.name for row in rows] == ["latent_update_vs_builtin", "latent_linearisation", "latent_keyframe"]
    for row in rows:
        assert row.ratio == pytest.approx(row.ours / row.peer) and row.ratio > 0.0


def test_the_drive_is_followed() -> None:
    run = Drive.of(MODEL, 0)
    manager = run.manager()
    beliefs = [manager.process(step) for step in run.steps]
    best = planar_from_pose_vector(beliefs[-1].poses[0])
    assert np.linalg.norm(best[:2] - run.circuit.poses[len(run.steps) - 1][:2]) < 0.3
    assert [int(beliefs[-1].object_ids[n]) for n in beliefs[-1].associations[0]] == list(run.circuit.seen[POSES - 1][1])
