"""Studies of chapter 3: what they compute, what they leave behind, where their work runs."""

import json
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.commands import run_study
from semantic_slam_lab.repetitions import keyed_generator, repeat, scheduler
from semantic_slam_lab.studies.ch3 import localization, model_uncertainty
from semantic_slam_lab.studies.ch3.beliefs import biased, odometry_with_fixes
from semantic_slam_lab.studies.ch3.metrics import fans, summary, true_class_first
from semantic_slam_lab.studies.ch3.scenarios import given_scenario, random_scenario
from semantic_slam_lab.studies.ch3.simulation import draw_scores, simulate

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.errors import InputError

METRICS = (
    *("correct_rate_final", "correct_rate_overall", "msde_final", "nll", "ece", "brier"),
    *("log_mgr_final_p75", "log_mgr_final_p95", "log_mgr_overall_p75", "log_mgr_overall_p95"),
)


@pytest.mark.long
@pytest.mark.slow
def test_scores_are_of_the_true_class() -> None:
    """Mean and covariance of many draws are those of the process; dropout clouds are as wide as the noise."""
    scenario, settings = given_scenario("model_uncertainty")
    processes = ClassProcesses(scenario.models)
    generator = keyed_generator("test", 0)
    drawn = np.stack([draw_scores(processes, 0, scenario.track_m[:4], generator) for _ in range(4000)])
    mean, covariance = processes.posterior(scenario.track_m[:4])
    np.testing.assert_allclose(drawn.mean(axis=0), mean[0], atol=0.01)
    np.testing.assert_allclose(np.cov(drawn[:, :, 1].T), covariance[0, 1], atol=0.002)
    found = simulate(processes, 0, scenario.track_m, generator, sigma_max=settings["sigma_max"], num_samples=2000)
    noise, spread = found.noised - found.nominal, found.clouds.std(axis=1).mean(axis=1)
    assert spread.max() <= 0.31
    assert 0.7 < np.sqrt((noise**2).mean() / (spread**2).mean()) < 1.4


def test_summary_of_two_realisations() -> None:
    logs = np.log([[[0.5, 0.5 - 1e-9], [0.8, 0.2]], [[0.4, 0.6], [0.2, 0.8]]])
    found = summary(logs)
    assert set(found) == set(METRICS)
    assert found["correct_rate_final"] == 0.5 and found["correct_rate_overall"] == 0.5
    np.testing.assert_allclose(found["nll"], -np.log([0.5, 0.8, 0.4, 0.2]).mean())
    np.testing.assert_allclose(found["log_mgr_final_p75"], 0.75 * np.log(4.0))
    np.testing.assert_allclose(found["msde_final"], (0.04 + 0.64) / 2)
    np.testing.assert_allclose(fans(logs)["p_true"][1][4], 0.5)
    assert true_class_first(np.arange(3.0), 2).tolist() == [2.0, 0.0, 1.0]


def test_beliefs_learn_from_fixes() -> None:
    track = np.cumsum(np.ones((20, 2)), axis=0)
    errors = []
    for seed in range(200):
        belief = odometry_with_fixes(track, keyed_generator("belief", seed))
        errors.append([np.abs(belief.mean(k)[-1] - track[k]).max() for k in (6, 7, 14)])
    before, first, second = np.mean(errors, axis=0)
    assert before > 3.0 * first and second < 0.5
    offsets = biased(track, 16.0, shared=True).posterior(5).sample(50, keyed_generator("offset")) - track[:6]
    np.testing.assert_allclose(offsets, offsets[:, :1] + np.zeros((50, 6, 2)), atol=0.01)


@pytest.mark.long
@pytest.mark.slow
def test_a_realisation_does_not_depend_on_where_it_runs() -> None:
    arguments = [("random", "sigma_n", 3, index) for index in range(2)]
    here = [model_uncertainty.realisation(*each) for each in arguments]
    there = repeat(model_uncertainty.realisation, arguments, 2, "test")
    for one, other in zip(here, there, strict=True):
        assert all(np.array_equal(one[name], other[name]) for name in one)


def test_random_scenarios_differ_and_are_models() -> None:
    first, second = (random_scenario(keyed_generator("random", seed)) for seed in (0, 1))
    assert not np.array_equal(first.track_m, second.track_m)
    for model in first.models:
        assert isinstance(model, ClassModel)
        np.testing.assert_allclose(model.scores.sum(axis=1), 1.0)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("study", [model_uncertainty, localization])
def test_study_leaves_result_and_page(study: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "QUICK_REALISATIONS", 2)
    monkeypatch.setattr(localization, "TRACKS", 20)
    paths = study.run(tmp_path, quick=True, jobs=1, seed=1)
    result = json.loads((tmp_path / "result.json").read_text())
    assert [path.name for path in paths] == ["result.json", "result.html"]
    for name in ("ours", "recursive", "joint", "model_based", "simple_bayes"):
        assert set(METRICS) <= set(result["methods"][name]), name
        assert all(np.isfinite(result["methods"][name][metric]) for metric in METRICS)
    assert set(result["test_noise"]) == {"none", "sigma_n"}
    assert all(claim["measured"] for claim in result["claims"])
    page = (tmp_path / "result.html").read_text()
    assert page.count("data:image/png;base64,") >= 3 and 'src="http' not in page


@pytest.mark.long
@pytest.mark.slow
def test_work_goes_to_a_dask_cluster() -> None:
    from distributed import LocalCluster

    arguments = [("given", "sigma_n", 0, index) for index in range(2)]
    here = [model_uncertainty.realisation(*each) for each in arguments]
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        scheduler(cluster.scheduler_address),
    ):
        there = repeat(model_uncertainty.realisation, arguments, 2, "test")
    for one, other in zip(here, there, strict=True):
        np.testing.assert_allclose(one["ours"], other["ours"])


@pytest.mark.slow
def test_no_scheduler_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("semantic_slam.cluster.CONNECT_TIMEOUT", "1s")
    with pytest.raises(InputError, match="no Dask scheduler"), scheduler("tcp://127.0.0.1:9"):
        pass


def test_command_knows_the_studies() -> None:
    assert {"ch3_model_uncertainty", "ch3_localization"} <= set(run_study.STUDIES)
    assert run_study.parse(["ch3_localization", "--scheduler", "tcp://a:1"]).scheduler == "tcp://a:1"
