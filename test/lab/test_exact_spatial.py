"""The exact fixtures in space are what their scripts make: the same problem, and the same answer from fewer draws."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from semantic_slam_lab.exact import bodies, spatial
from semantic_slam_lab.exact.spatial_problem import SpatialProblem, moved

FOLDER = Path(__file__).parents[1] / "fixtures"
SCRIPTS = {"ch4_se3_N3_k2_n2": spatial.problem, "ch4_se3_N2_k2_n2_bodies": bodies.problem}


@pytest.fixture(params=SCRIPTS)
def fixture(request: pytest.FixtureRequest) -> tuple[SpatialProblem, dict]:
    return SCRIPTS[request.param](), json.loads((FOLDER / f"{request.param}.json").read_text(encoding="utf-8"))


def test_the_fixture_is_of_the_script_s_problem(fixture: tuple[SpatialProblem, dict]) -> None:
    """To rounding, which is not the same on all processors."""
    problems = fixture[0].given, fixture[1]["input"]
    made, kept = (json.loads(json.dumps(own), parse_float=lambda text: f"{float(text):.9f}") for own in problems)
    assert made == kept


@pytest.mark.long
def test_few_draws_agree_with_the_fixture(
    fixture: tuple[SpatialProblem, dict], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spatial, "DRAWS", spatial.CHUNK)
    problem, data = fixture
    rows = data["expected"]["hypotheses"]
    best = max(range(len(rows)), key=lambda row: float(rows[row]["weight"]))
    found = spatial.sampled(problem, problem.explanations()[best], seed=9)
    assert found.log_evidence == pytest.approx(rows[best]["log_evidence"], abs=4.0 * found.relative_error)
    assert found.relative_error < 0.03


def test_a_move_is_the_matrix_exponential_of_its_tangent() -> None:
    generator = np.random.default_rng(0)
    tangents = generator.normal(size=(20, 6)) * np.array([*[1.0] * 3, *[2.0] * 3])
    turns, places = Rotation.random(20, rng=1), generator.normal(size=(20, 3))
    turned, placed = moved((turns, places), tangents)
    for row, (w, v) in enumerate(zip(tangents[:, :3], tangents[:, 3:], strict=True)):
        step = np.zeros((4, 4))
        step[:3, :3], step[:3, 3] = [[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]], v
        state = np.eye(4)
        state[:3, :3], state[:3, 3] = turns[row].as_matrix(), places[row]
        after = state @ expm(step)
        np.testing.assert_allclose(turned[row].as_matrix(), after[:3, :3], atol=1e-10)
        np.testing.assert_allclose(placed[row], after[:3, 3], atol=1e-10)
