"""Studies of chapter 4: what they simulate, what they compute and what they leave behind."""

import json
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.commands import run_study
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.ch4 import example, scenarios, statistics
from semantic_slam_lab.studies.ch4.claims import claims
from semantic_slam_lab.studies.ch4.methods import METHODS_OF, OURS, SAMPLED, WITH, WITHOUT
from semantic_slam_lab.studies.ch4.metrics import METRICS, row_of, summary
from semantic_slam_lab.studies.ch4.runs import Followed, Method, follow
from semantic_slam_lab.studies.ch4.scenarios import (
    LEAST_CLEARANCE_M,
    LEAST_SEPARATION_M,
    given_scenario,
    long_path,
    random_scenario,
    visible,
    walk,
)
from semantic_slam_lab.studies.ch4.simulation import features, simulate

from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry import se2
from semantic_slam.inference.engine import Engine
from semantic_slam.viewpoint.parametric import ParametricModel

FIELDS = (
    *("association_entropy", "component_entropy", "det_position_covariance", "error_max_weight_m"),
    *("error_weighted_m", "p_true_association_final", "runs_lost"),
)


def test_given_scenario_is_that_of_section_4_4() -> None:
    scenario, paths = given_scenario()
    assert paths.shape == (50, 10, 3)
    np.testing.assert_allclose(scenario.start_variance, [100.0, 100.0, 0.04])
    np.testing.assert_allclose(scenario.start_mean - scenario.start, [4.0, 3.0, 0.0])
    assert len(long_path(scenario)) == 25
    last = walk(scenario.start, long_path(scenario))[-1]
    assert {0, 1} <= set(visible(scenario, last).tolist()), "the objects apart from the row are seen at the end"


def test_what_is_seen_is_near_and_ahead() -> None:
    """From the origin, looking along x with 140 degrees: one too far, one behind, four inside of which three count."""
    scenario, _ = given_scenario()
    places = [[8.0, 0.0], [-1.0, 0.0], [2.0, 0.0], [6.0, 3.0], [3.0, -3.0], [1.0, 2.0]]
    world = scenario.__class__(**{**vars(scenario), "objects": np.hstack([np.array(places), np.zeros((6, 1))])})
    assert visible(world, np.zeros(3)).tolist() == [2, 5, 4]


def test_measurements_follow_the_models() -> None:
    """Residuals of many runs have the moments that the engine is told: motion, map, range and bearing, scores."""
    scenario, paths = given_scenario()
    model = ParametricModel(0.5, scenario.concentration)
    motion, maps, geometry, semantics = [], [], [], []
    for index in range(150):
        run = simulate(scenario, paths[index % 50], keyed_generator("moments", index))
        before = np.vstack([run.start, run.poses[:-1]])
        motion.append(se2.log(se2.between(se2.compose(before, run.controls), run.poses)))
        maps.append(se2.log(se2.between(run.map_means, scenario.objects)))
        for pose, frame in zip(run.poses, run.frames, strict=True):
            relative = se2.between(np.broadcast_to(pose, (len(frame.seen), 3)), scenario.objects[list(frame.seen)])
            exact = np.stack([np.hypot(*relative[:, :2].T), np.arctan2(relative[:, 1], relative[:, 0])], axis=-1)
            geometry.append(frame.range_bearing - exact)
            camera = se2.inverse(relative)
            direction = np.arctan2(camera[:, 1], camera[:, 0])
            first = 0.5 * np.sin(direction / 2.0) ** 2 + 0.5
            semantics.append(features(frame, model) - np.stack([first, 1.0 - first], axis=-1))
    _assert_moments(np.vstack(motion), np.diag(scenario.process_variance))
    _assert_moments(np.vstack(maps), np.diag(scenario.object_variance))
    _assert_moments(np.vstack(geometry), np.diag(scenario.range_bearing_variance))
    _assert_moments(np.vstack(semantics), np.array([[1.25, 0.5], [0.5, 1.0]]) / 15.0**2)


def _assert_moments(residuals: np.ndarray, covariance: np.ndarray) -> None:
    """Within about four standard errors of mean and covariance."""
    whitened = residuals @ np.linalg.inv(np.linalg.cholesky(covariance)).T
    allowed = 4.0 / np.sqrt(len(residuals))
    np.testing.assert_allclose(whitened.mean(axis=0), 0.0, atol=allowed)
    np.testing.assert_allclose(np.cov(whitened.T), np.eye(len(covariance)), atol=1.5 * allowed)


def test_models_share_a_run_and_its_geometry() -> None:
    scenario, paths = given_scenario()
    drawn, exact = (simulate(scenario, paths[0], keyed_generator("same"), exact_map=flag) for flag in (False, True))
    np.testing.assert_array_equal(drawn.poses, exact.poses)
    np.testing.assert_array_equal(drawn.frames[3].range_bearing, exact.frames[3].range_bearing)
    np.testing.assert_allclose(exact.map_means, scenario.objects, atol=1e-12)
    assert np.abs(drawn.map_means - scenario.objects).max() > 0.1


def test_random_layouts_keep_apart() -> None:
    (first, path), (second, _) = (random_scenario(keyed_generator("layout", n)) for n in range(2))
    assert not np.array_equal(first.objects, second.objects)
    spots, track = first.objects[:, :2], walk(first.start, path)[:, :2]
    between = np.linalg.norm(spots[:, None] - spots, axis=-1) + 1e9 * np.eye(len(spots))
    assert between.min() >= LEAST_SEPARATION_M
    assert len(visible(first, walk(first.start, path)[1])) > 0
    assert np.linalg.norm(spots[:, None] - track, axis=-1).min() >= LEAST_CLEARANCE_M


def test_a_run_depends_on_its_seed_alone() -> None:
    here, again, other = (
        row_of(follow(statistics.simulated_run("random", seed, 1), SAMPLED, seed), 10) for seed in (3, 3, 4)
    )
    for metric in METRICS:
        np.testing.assert_array_equal(here[metric], again[metric])
    assert not np.array_equal(here["error_weighted_m"], other["error_weighted_m"])


@pytest.mark.long
@pytest.mark.slow
def test_semantics_disambiguate_a_run() -> None:
    """The first given track: probabilities sum to one, and the scores settle what geometry leaves open."""
    run = statistics.simulated_run("exact_map", 0, 0)
    ours, without = (follow(run, method, 0) for method in (OURS, WITHOUT))
    for followed in (ours, without):
        assert not followed.fault
        for moment in followed.moments:
            np.testing.assert_allclose(sum(moment.associations.values()), 1.0)
    assert ours.moments[-1].association_entropy < 0.5 * without.moments[-1].association_entropy
    assert ours.moments[-1].p_true_association > 0.99 > without.moments[-1].p_true_association


def test_a_lost_run_is_counted_and_leaves_no_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """From where every hypothesis is gone there is no estimate, and no probability for the truth."""
    process = Engine.process

    def fails_at_three(manager: Engine, step: object) -> object:
        if step.index == 3:
            raise SemanticSlamError("no candidate explains the measurements")
        return process(manager, step)

    run = statistics.simulated_run("given", 0, 0)
    method = Method(0.25, weights="laplace")
    whole = row_of(follow(run, method, 0), 10)
    monkeypatch.setattr(Engine, "process", fails_at_three)
    lost = follow(run, method, 0)
    assert len(lost.moments) == 3 and lost.fault == "k = 4: no candidate explains the measurements"
    found = summary([whole, row_of(lost, 10)])
    assert found["runs_lost"] == 1
    assert found["p_true_association_final"] == whole["p_true_association"][-1] / 2.0
    assert found["final"]["error_weighted_m"] == whole["error_weighted_m"][-1]
    assert summary([row_of(Followed((), "k = 1: gone"), 10)])["error_weighted_m"] is None


def test_names_of_methods() -> None:
    assert [method.name for method in WITH] == ["0.05", "0.25", "0.5", "0.75", "1.0"]
    assert (WITHOUT.name, SAMPLED.name) == ("no_semantics", "0.25_sampled")
    assert Method(0.25, weights="laplace").name == "0.25_laplace"


def test_claims_are_measured() -> None:
    """Worlds made by hand: semantics better in all, then a single alpha worse in one metric."""
    row = {"runs": 10, "runs_lost": 0, "truth_lost": 0, "confidence": 0.9, "likeliest_is_true": 0.9}
    of_the_end = ("p_true_association_final", "p_true_association_least", "discarded_mass_final")
    metrics = {name: 1.0 for name in (*METRICS[:6], *of_the_end)}
    worlds = {world: {m.name: {**row, **metrics} for m in methods} for world, methods in METHODS_OF.items()}
    for methods in worlds.values():
        methods[WITHOUT.name] = {**row, **{name: 9.0 for name in metrics}}
    for beginning in ("Semantics lower", "No run", "At the"):
        assert {claim.holds for claim in claims(worlds) if claim.text.startswith(beginning)} == {True}, beginning
    worlds["given"]["0.5"]["error_weighted_m"] = 10.0
    worlds["exact_map"]["0.25"]["runs_lost"] = 1
    wrong = [claim.text for claim in claims(worlds) if not claim.holds and not claim.text.startswith("Stronger")]
    assert [text[:40] for text in wrong][:2] == [
        "No run loses all its hypotheses, with se",
        "Semantics lower error, weighted for ever",
    ]


@pytest.mark.long
@pytest.mark.slow
def test_statistics_leave_result_and_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario, given_paths = given_scenario()
    monkeypatch.setattr(statistics, "QUICK_RUNS", {"given": 1, "exact_map": 1, "random": 1})
    monkeypatch.setattr(statistics, "given_scenario", lambda: (scenario, given_paths[:3, :2]))
    monkeypatch.setattr(scenarios, "RANDOM_STEPS", 2)
    paths = statistics.run(tmp_path, quick=True, jobs=1, seed=1)
    result = json.loads((tmp_path / "result.json").read_text())
    assert [path.name for path in paths] == ["result.json", "result.html"]
    assert set(result["alphas"]) == {"0.05", "0.25", "0.5", "0.75", "1.0"}
    for row in (*result["alphas"].values(), result["no_semantics"], *result["methods"].values()):
        assert all(np.isfinite(row[field]) for field in FIELDS)
    assert len(result["no_semantics"]["steps"]["association_entropy"]["percentiles"]) == 2
    assert all(claim["measured"] for claim in result["claims"])
    page = (tmp_path / "result.html").read_text()
    assert page.count("data:image/png;base64,") == 4 and 'src="http' not in page


@pytest.mark.long
@pytest.mark.slow
def test_example_leaves_result_and_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(example, "QUICK_REPETITIONS", 1)
    monkeypatch.setattr(example, "SHOWN", (1, 2, 3, 4))
    monkeypatch.setattr(example, "long_path", lambda scenario: long_path(scenario)[:4])
    example.run(tmp_path, quick=True, jobs=1, seed=0)
    result = json.loads((tmp_path / "result.json").read_text())
    for name in ("ours", "no_semantics"):
        assert result["methods"][name]["runs_lost"] == 0
        rows = result["shown"][name]
        assert [row["k"] for row in rows] == list(range(1, 5))
        np.testing.assert_allclose([sum(row["weights"]) for row in rows], 1.0)
    assert (tmp_path / "result.html").read_text().count("data:image/png;base64,") == 4


def test_command_knows_the_studies() -> None:
    assert {"ch4_example", "ch4_statistics"} <= set(run_study.STUDIES)
