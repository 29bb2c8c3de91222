"""Every shipped way in which views weigh keeps the contract."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.configuration import Configuration
from semantic_slam.contracts.association_strategy import OBJECTS
from semantic_slam.contracts.semantics import SemanticsContract, Weighed
from semantic_slam.inference.building.views import semantics_name
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.registry import SEMANTICS

pytestmark = pytest.mark.slow  # many short runs of the engine

LABELS = ["chair", "cup", "tv"]


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


class DetectorLabelsContract(SemanticsContract):
    """A detector calls every object by one of three labels, now and then by another."""

    others = {"semantic_model": {"kind": "detector", "labels": LABELS}}  # noqa: RUF012

    def keyframes(self) -> list[Keyframe]:
        random = np.random.default_rng(5)
        return [_called(keyframe, random) for keyframe in super().keyframes()]

    def test_words_tell_associations_apart(self, asked: list[tuple[Weighed, Weighed, Weighed]]) -> None:
        if self.association != "given":  # which leaves nothing to tell apart
            assert max(np.ptp(weighed.evidence.log_weights) for weighed, _, _ in asked) > 0.5


class TestDetectorLabels(DetectorLabelsContract):
    association = "open"


class TestDetectorLabelsOfTracks(DetectorLabelsContract):
    """Boxes of one track are of one object."""

    association = "open"
    others = {**DetectorLabelsContract.others, "open_world": {"track_error_share": 0.02}}  # noqa: RUF012

    def test_tracks_tell_associations_apart(self, asked: list[tuple[Weighed, Weighed, Weighed]]) -> None:
        assert max(np.ptp(weighed.evidence.log_weights) for weighed, _, _ in asked) > np.log(0.98 / 0.02)


class TestDetectorLabelsOnAMap(DetectorLabelsContract):
    association = "enumerated"


class TestDetectorLabelsOfNamedObjects(DetectorLabelsContract):
    association = "given"


class EmbeddingViewsContract(SemanticsContract):
    """Every object has looks of its own, which its views show with noise; now and then a detection has no vector."""

    others = {"semantic_model": {"kind": "embedding"}}  # noqa: RUF012
    num_keyframes = 4  # until something is seen again

    def keyframes(self) -> list[Keyframe]:
        random = np.random.default_rng(6)
        looks = random.normal(size=(len(OBJECTS), 40))
        return [_looking(keyframe, looks, random) for keyframe in super().keyframes()]

    def test_looks_tell_associations_apart(self, asked: list[tuple[Weighed, Weighed, Weighed]]) -> None:
        if self.association != "given":  # which leaves nothing to tell apart
            assert max(np.ptp(weighed.evidence.log_weights) for weighed, _, _ in asked) > 1.0


class TestEmbeddingViews(EmbeddingViewsContract):
    association = "open"


class TestEmbeddingViewsOnAMap(EmbeddingViewsContract):
    association = "enumerated"


class TestEmbeddingViewsOfNamedObjects(EmbeddingViewsContract):
    association = "given"


class LabelsAndVectorsContract(EmbeddingViewsContract):
    """Two objects have each label, and every object has looks of its own."""

    others = {"semantic_model": {"kind": "detector_embedding", "labels": LABELS}}  # noqa: RUF012

    def keyframes(self) -> list[Keyframe]:
        random = np.random.default_rng(5)
        return [_called(keyframe, random) for keyframe in super().keyframes()]

    def test_what_had_a_vector_has_an_appearance_beside_its_class(
        self, asked: list[tuple[Weighed, Weighed, Weighed]]
    ) -> None:
        last = asked[-1][0].records[0]
        assert any(record.appearance is not None for record in last.values())
        assert all(record.recent and record.log_likelihood.size == len(LABELS) + 1 for record in last.values())


class TestLabelsAndVectors(LabelsAndVectorsContract):
    association = "open"


class TestLabelsAndVectorsOnAMap(LabelsAndVectorsContract):
    association = "enumerated"


class TestLabelsAndVectorsOfNamedObjects(LabelsAndVectorsContract):
    association = "given"


def _looking(keyframe: Keyframe, looks: np.ndarray, random: np.random.Generator) -> Keyframe:
    measurements = keyframe.measurements
    numbers = [int(name.removeprefix("object_")) for name in measurements.track_ids]
    vectors = looks[numbers] + random.normal(0.0, 0.2, (len(numbers), looks.shape[1]))
    vectors[random.random(len(numbers)) < 0.1] = np.nan
    return replace(keyframe, measurements=replace(measurements, embeddings=vectors))


def _called(keyframe: Keyframe, random: np.random.Generator) -> Keyframe:
    measurements = keyframe.measurements
    numbers = [int(name.removeprefix("object_")) % len(LABELS) for name in measurements.track_ids]
    labels = [str(random.choice(LABELS)) if random.random() < 0.2 else LABELS[number] for number in numbers]
    return replace(keyframe, measurements=replace(measurements, labels=tuple(labels)))


def test_every_kind_of_semantics_is_tested() -> None:
    tested = [each for each in globals().values() if _is_tested(each)]
    settings = [Configuration.of(association=each.association, **each.others) for each in tested]
    assert {semantics_name(each) for each in settings} == set(SEMANTICS.own_names)


def _is_tested(each: object) -> bool:
    return isinstance(each, type) and issubclass(each, SemanticsContract) and each.__name__.startswith("Test")
