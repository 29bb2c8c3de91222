"""Contract test of semantics (how views weigh hypotheses): a subclass names the class models under test."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import pytest

from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import Configuration
from semantic_slam.contracts.association_strategy import OBJECTS, AssociationStrategyContract
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.building import problem_of
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.semantics.interface import ClassModels, SemanticEvidence, SemanticInput, Semantics
from semantic_slam.inference.states.object_views import ObjectViews


@dataclass(frozen=True, kw_only=True)
class Weighed:
    """Evidence of a keyframe's K candidates with all their view records, taken while the parents are still intact."""

    given: SemanticInput
    evidence: SemanticEvidence
    records: list[dict[int, ObjectViews]]  # K

    @classmethod
    def by(cls, semantics: Semantics, given: SemanticInput) -> "Weighed":
        """Weigh ``given`` with ``semantics`` and take the records of all candidates."""
        evidence = semantics.weigh(given)
        return cls(given=given, evidence=evidence, records=evidence.records(range(len(evidence.log_weights))))


class WitnessSemantics:
    """Semantics that weighs each keyframe twice, then every second candidate alone, with the semantics under test."""

    def __init__(self, semantics: Semantics) -> None:
        self._semantics = semantics
        self.asked: list[tuple[Weighed, Weighed, Weighed]] = []

    @classmethod
    def of(cls, models: ClassModels) -> Self:
        """Not used: no registry names the witness."""
        raise NotImplementedError("the witness is made around semantics")

    def weigh(self, given: SemanticInput) -> SemanticEvidence:
        """Weigh three ways, store all, and return the first evidence, with which the run continues."""
        some = given.take(np.arange(0, len(given.candidates.assignments), 2))
        first, again, part = (Weighed.by(self._semantics, each) for each in (given, given, some))
        self.asked.append((first, again, part))
        return first.evidence


class SemanticsContract(AssociationStrategyContract):
    """Subclass and set ``others = {"semantic_model": {"kind": ...}}``; ``association`` may be open-world.

    The association contract is tested as well: the hypotheses do not depend on how backends share them.
    """

    association = "enumerated"
    num_keyframes = 3
    rebuilt_within = 1e-9  # with the broad initial pose, iSAM2's last bits depend on the queries made in between
    taken_within = 1e-9  # tolerance [nats] of log weights of candidates that are weighed alone

    def keyframes(self) -> list[Keyframe]:
        """Keyframes of the association contract, each detection with its object's feature plus noise."""
        settings = Configuration.of(**self.others).semantic_model
        model = load_model(settings) or load_latent_model(settings)
        random, size = np.random.default_rng(4), 0 if model is None else model.num_features
        looks = random.dirichlet(np.ones(max(size, 1)), size=len(OBJECTS))[:, :size]
        return [_with_features(keyframe, looks, random) for keyframe in super().keyframes()]

    @pytest.fixture(scope="class")
    @classmethod
    def asked(cls) -> list[tuple[Weighed, Weighed, Weighed]]:
        """Per keyframe: the first result, the repeated one, and that of every second candidate alone."""
        contract = cls()
        problem = problem_of(contract.run())
        witness = WitnessSemantics(problem.semantics)
        watched = replace(problem, semantics=witness)
        engine = Engine.of_run(contract.run(), InProcessPool(1, watched), watched)
        for keyframe in contract.keyframes():
            engine.process(keyframe)
        assert witness.asked
        return witness.asked

    def test_there_is_evidence_for_every_candidate(self, asked: list[tuple[Weighed, Weighed, Weighed]]) -> None:
        for weighed, _, _ in asked:
            count, evidence = len(weighed.given.candidates.assignments), weighed.evidence
            assert evidence.log_weights.shape == evidence.effective_sample_sizes.shape == (count,)
            assert len(evidence.robot) == len(weighed.records) == count
            assert np.isfinite(evidence.log_weights).all()

    def test_records_are_of_objects_that_the_candidate_sees_or_has_seen(
        self, asked: list[tuple[Weighed, Weighed, Weighed]]
    ) -> None:
        for weighed, _, _ in asked:
            ids, rows = weighed.given.candidates.object_ids, weighed.given.candidates.assignments
            for row, parent, records in zip(rows.objects, rows.parents.tolist(), weighed.records, strict=True):
                assert set(records) <= set(ids[row[row >= 0]].tolist()) | set(weighed.given.parents[parent].views)

    def test_records_say_how_likely_each_class_is(self, asked: list[tuple[Weighed, Weighed, Weighed]]) -> None:
        for weighed, _, _ in asked:
            for record in (record for records in weighed.records for record in records.values()):
                assert record.log_likelihood.shape == (weighed.given.log_class_prior.shape[1],)
                assert np.isfinite(record.log_likelihood).all()
                assert not record.mutual_information < -1e-9  # NaN where the models draw no samples

    def test_to_be_asked_again_changes_nothing(self, asked: list[tuple[Weighed, Weighed, Weighed]]) -> None:
        for weighed, again, _ in asked:
            np.testing.assert_array_equal(again.evidence.log_weights, weighed.evidence.log_weights)
            _same_records(again.records, weighed.records, 0.0)

    def test_candidates_do_not_depend_on_those_beside_them(self, asked: list[tuple[Weighed, Weighed, Weighed]]) -> None:
        for weighed, _, some in asked:
            expected = weighed.evidence.log_weights[::2]
            np.testing.assert_allclose(some.evidence.log_weights, expected, rtol=0.0, atol=self.taken_within)
            _same_records(some.records, weighed.records[::2], self.taken_within)


def _with_features(keyframe: Keyframe, looks: Array, random: np.random.Generator) -> Keyframe:
    """Keyframe with a feature per detection, whose track id names its row of ``looks`` (O, F)."""
    measurements = keyframe.measurements
    rows = [int(name.removeprefix("object_")) for name in measurements.track_ids]
    features = looks[rows] + random.normal(0.0, 0.02, (len(rows), looks.shape[1]))
    covariances = np.tile(1e-4 * np.eye(looks.shape[1]), (len(rows), 1, 1))
    return replace(keyframe, measurements=replace(measurements, features=features, feature_covariances=covariances))


def _same_records(some: list[dict[int, ObjectViews]], others: list[dict[int, ObjectViews]], tolerance: float) -> None:
    for one, other in zip(some, others, strict=True):
        assert one.keys() == other.keys()
        for number, record in one.items():
            np.testing.assert_allclose(
                record.log_likelihood, other[number].log_likelihood, rtol=0.0, atol=tolerance, err_msg=str(number)
            )
