"""Every shipped way in which views weigh keeps the contract."""

import pytest

from semantic_slam.configuration import Configuration
from semantic_slam.contracts.semantics import SemanticsContract
from semantic_slam.inference.build import semantics_name
from semantic_slam.registry import SEMANTICS

pytestmark = pytest.mark.slow  # many short runs of the engine


class TestNoSemantics(SemanticsContract):
    others = {"semantic_model": {"kind": "none"}}  # noqa: RUF012


@pytest.mark.slow
class TestIndependentViews(SemanticsContract):
    others = {"semantic_model": {"kind": "gp_independent"}, "pruning": {"max_hypotheses": 5}}  # noqa: RUF012


@pytest.mark.slow
class TestCorrelatedViews(SemanticsContract):
    others = {"semantic_model": {"kind": "gp_correlated", "num_tracks": 40}}  # noqa: RUF012


class TestClassTables(SemanticsContract):
    association = "open"
    others = {"semantic_model": {"kind": "gp_independent"}}  # noqa: RUF012


class TestDescriptorViews(SemanticsContract):
    others = {"semantic_model": {"kind": "latent"}}  # noqa: RUF012


class TestDescriptorTables(SemanticsContract):
    association = "open"
    others = {"semantic_model": {"kind": "latent"}}  # noqa: RUF012


def test_none_is_left_out() -> None:
    tested = SemanticsContract.__subclasses__()
    settings = [Configuration.of(association=each.association, **each.others) for each in tested]
    assert {semantics_name(each) for each in settings} == set(SEMANTICS.own_names)
