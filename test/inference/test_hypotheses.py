"""Manager and backends: the same belief however the work is divided, and rounds that can be repeated."""

import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest
from worlds.same_beliefs import SUBSTANCE, assert_same
from worlds.scenes.planar_world import OBJECTS, World, beliefs, make_world

from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.errors import InputError, SemanticSlamError
from semantic_slam.inference import expander
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.ownership import assign_owners
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates, Commit, Components
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.world.map_prior import MapPrior, parse_map_prior

NOTHING_WRONG: dict[str, Any] = {
    "semantic_model": {"kind": "parametric", "outlier_share": 0.0},
    "closed_world": {"clutter_per_frame": 0.0},
}


@cache
def alone(num_keyframes: int) -> tuple[World, list[HybridBelief]]:
    """A drive, and its beliefs by one backend."""
    world = make_world(num_keyframes)
    return world, beliefs(world, 1)


def test_a_lost_robot_finds_itself_and_the_classes() -> None:
    world = make_world(16)
    belief = beliefs(world, 1)[-1]
    assert np.hypot(*(belief.poses[0, :2] - world.truth[-1, :2])) < 0.5
    assert belief.association_entropy < 0.1
    seen = sorted({n for frame in world.associations for n in frame})
    assert (belief.class_probabilities[seen, 0] > 0.9).all()
    assert np.exp(belief.log_weights).sum() == pytest.approx(1.0)
    assert 0.0 < belief.discarded_mass < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("num_backends", [2, 3])
def test_the_number_of_backends_changes_nothing(num_backends: int) -> None:
    world, whole = alone(8)
    for single, divided in zip(whole, beliefs(world, num_backends), strict=True):
        assert_same(single, divided)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        {"pruning": {"ratio": 1e12}},
        {"semantic_model": {"kind": "none"}, "pruning": {"ratio": 1e9}},
        {"semantic_model": {"kind": "none"}, "weights": {"gaussian_share": 0.9999, "max_history": 6}},
    ],
)
def test_not_a_bit_depends_on_what_is_worked_on_together(overrides: dict[str, Any]) -> None:
    world = make_world(4, **overrides)
    runs = [beliefs(world, number) for number in (1, 2, 3)]
    assert max(len(belief.hypothesis_ids) for belief in runs[0]) > 1
    for single, *divided in zip(*runs, strict=True):
        for other in divided:
            for name in SUBSTANCE:
                np.testing.assert_array_equal(getattr(single, name), getattr(other, name), err_msg=name)


def test_sampled_weights_are_reproducible_too() -> None:
    world = make_world(3, sigma_start_m=1.0, weights={"method": "sampled", "num_samples": 500})
    for single, divided in zip(beliefs(world, 1), beliefs(world, 2), strict=True):
        assert_same(single, divided)


@pytest.mark.slow
@pytest.mark.parametrize("dies_at", [0, 1, 5])
def test_hypotheses_of_a_lost_backend_are_rebuilt_elsewhere(dies_at: int) -> None:
    world, whole = alone(8)
    manager = Engine.of_run(world.run, ForgetfulPool(2, dies_at))
    for keyframe, expected in zip(world.keyframes, whole, strict=True):
        assert_same(manager.process(keyframe), expected)


class RememberingPool(InProcessPool):
    """Knows the newest commit."""

    newest: Commit

    def commit(self, commit: Commit) -> list[Components]:
        self.newest = commit
        return super().commit(commit)


class SilentPool(InProcessPool):
    """All backends are gone between the rounds."""

    def commit(self, commit: Commit) -> list[Components]:
        self.backend_ids = ()
        return []


def test_hypotheses_that_no_backend_answered_for_are_counted() -> None:
    world = make_world(1, **NOTHING_WRONG)
    manager = Engine.of_run(world.run, SilentPool(1))
    with pytest.raises(SemanticSlamError, match=r"lost \(1 x no backend answered\); check .* backends"):
        manager.process(world.keyframes[0])
    assert manager.lost == {"hypothesis lost: no backend answered": 1}


def test_hypotheses_that_had_to_be_given_up_are_counted_by_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    world, grown = make_world(4, semantic_model={"kind": "none"}), expander.grow

    def first_fails(*arguments: Any, **options: Any) -> list[Any]:
        return [LostComponentError("an update failed (indeterminate)"), *grown(*arguments, **options)[1:]]

    pool = RememberingPool(1)
    manager = Engine.of_run(world.run, pool)
    beliefs = [manager.process(keyframe) for keyframe in world.keyframes[:2]]
    monkeypatch.setattr(expander, "grow", first_fails)
    beliefs.append(manager.process(world.keyframes[2]))
    assert manager.lost == {"hypothesis lost: an update failed (indeterminate)": 1}
    assert beliefs[2].discarded_mass > beliefs[1].discarded_mass
    assert pool.commit(pool.newest)[0].lost_reasons == ("an update failed (indeterminate)",)  # said again, the same
    nothing = LostComponentError("not finite")
    monkeypatch.setattr(expander, "grow", lambda parents, *_, **options: [nothing] * len(parents))
    with pytest.raises(SemanticSlamError, match=r"every hypothesis was lost \(\d x not finite\); check"):
        manager.process(world.keyframes[3])


class DyingPool(InProcessPool):
    """Loses its first backend between the rounds of a keyframe."""

    def __init__(self, number: int, dies_at: int):
        super().__init__(number)
        self._dies_at = dies_at

    def commit(self, commit: Commit) -> list[Components]:
        if commit.keyframe == self._dies_at and 0 in self.backend_ids:
            self.backend_ids = self.backend_ids[1:]
            self._backends = self._backends[1:]
        return super().commit(commit)


@pytest.mark.parametrize("dies_at", [0, 4])
def test_a_backend_lost_between_the_rounds_costs_nothing(dies_at: int) -> None:
    world, whole = alone(6)
    manager = Engine.of_run(world.run, DyingPool(2, dies_at))
    for keyframe, expected in zip(world.keyframes, whole, strict=True):
        assert_same(manager.process(keyframe), expected)


class RepeatingPool(InProcessPool):
    """Says everything twice, and repeats an old commit."""

    def __init__(self) -> None:
        super().__init__(2)
        self._old: Commit | None = None
        self.stale_answers: list[Components] = []

    def expand(self, keyframe) -> list[Candidates]:
        super().expand(keyframe)
        answers = super().expand(keyframe)
        if self._old is not None:
            super().commit(self._old)
        return answers

    def commit(self, commit: Commit) -> list[Components]:
        super().commit(commit)
        answers = super().commit(commit)
        if self._old is not None:
            self.stale_answers += super().commit(self._old)
        self._old = commit
        return answers


@pytest.mark.slow
def test_rounds_are_idempotent_and_stale_commits_are_ignored() -> None:
    world, whole = alone(6)
    pool = RepeatingPool()
    manager = Engine.of_run(world.run, pool)
    for keyframe, expected in zip(world.keyframes, whole, strict=True):
        assert_same(manager.process(keyframe), expected)
    assert pool.stale_answers == []


def test_a_gap_between_keyframes_is_an_error() -> None:
    world = make_world(3)
    backend = Backend(0)
    backend.start(world.run)
    backend.expand(world.keyframes[0])
    with pytest.raises(SemanticSlamError, match="keyframe 1 is missing"):
        backend.expand(world.keyframes[2])


def test_owners_keep_their_children_until_they_are_full() -> None:
    assert assign_owners([0, 0, 1, 0], [0, 1], 9) == [0, 0, 1, 0]
    assert assign_owners([0, 0, 1, 0], [0, 1], 2) == [0, 0, 1, 1]  # short lineages move for less
    assert assign_owners([0] * 4, [0, 1], 9) == [0, 0, 0, 1]
    assert assign_owners([7, 7], [0, 1], 9) == [0, 1]


def test_given_identities_create_objects_without_a_map() -> None:
    """Without a map prior the heading of the objects rests on the semantics and a broad prior; positions are found."""
    world = make_world(10, association="given", sigma_start_m=0.01, semantic_model={"kind": "none"})
    belief = beliefs(world, 1)[-1]
    order = [int(name.removeprefix("tree_")) for name in belief.object_names]
    estimated = belief.object_poses[:, :2] - belief.poses[0, :2]
    offset = np.array([4.0, -3.0, 0.1])  # of the prior mean: the map is relative to the start
    turn = np.array([[np.cos(offset[2]), -np.sin(offset[2])], [np.sin(offset[2]), np.cos(offset[2])]])
    expected = (OBJECTS[order, :2] - world.truth[-1, :2]) @ turn.T
    assert np.abs(estimated - expected).max() < 0.6
    assert (belief.object_covariances[:, 5, 5] > 1.0).all()
    assert len(belief.log_weights) == 1


def test_a_detection_without_identity_is_left_out_when_identities_are_given() -> None:
    world = make_world(2, association="given", semantic_model={"kind": "none"})
    anonymous = dataclasses.replace(
        world.keyframes[0].measurements, track_ids=("",) * len(world.keyframes[0].measurements)
    )
    manager = Engine.of_run(world.run, InProcessPool(1))
    belief = manager.process(dataclasses.replace(world.keyframes[0], measurements=anonymous))
    assert (belief.associations == -1).all()


def test_enumeration_needs_a_map() -> None:
    from semantic_slam.configuration import Configuration
    from semantic_slam.inference.building import make_run_configuration

    with pytest.raises(InputError, match="no map prior"):
        make_run_configuration(Configuration(), None, np.zeros(7), np.zeros((6, 6)), stamp_ns=0)


def test_features_of_another_classifier_are_refused() -> None:
    world = make_world(1)
    measurements = world.keyframes[0].measurements
    wrong = dataclasses.replace(measurements, features=np.zeros((len(measurements), 3)))
    manager = Engine.of_run(world.run, InProcessPool(1))
    with pytest.raises(InputError, match="3 feature components"):
        manager.process(dataclasses.replace(world.keyframes[0], measurements=wrong))


def test_scores_of_other_classes_are_refused_though_there_are_as_many() -> None:
    world = make_world(1)
    measurements = world.keyframes[0].measurements
    wrong = dataclasses.replace(measurements, class_names=tuple(f"other {name}" for name in measurements.class_names))
    manager = Engine.of_run(world.run, InProcessPool(1))
    with pytest.raises(InputError, match=r"scores of other .* fit viewpoint models"):
        manager.process(dataclasses.replace(world.keyframes[0], measurements=wrong))


def candidates_of_a_pair(**overrides: object) -> Candidates:
    """Candidates for the first frame with two detections, from the prior alone; everything is enumerated."""
    everything = {
        "weights": {"gate": 1e9, "max_candidates": 10**6, "max_associations": 0},
        "semantic_model": {"kind": "none"},
    }
    world = make_world(6, **{**everything, **overrides})
    keyframe = next(k for k in world.keyframes if len(k.measurements) == 2)
    backend = Backend(0)
    backend.start(world.run)
    return backend.expand(dataclasses.replace(keyframe, index=0))


@pytest.mark.parametrize(("distinct", "number"), [(True, 5 * 4 + 11), (False, 5 * 5 + 11)])
def test_an_object_takes_two_detections_of_a_frame_only_where_that_is_allowed(distinct: bool, number: int) -> None:
    """Besides the pairs of five objects there are 11 associations in which one detection or both are of none."""
    candidates = candidates_of_a_pair(distinct_assignment=distinct)
    assert len(candidates.ids) == number
    repeated = (candidates.associations[:, 0] == candidates.associations[:, 1]) & (candidates.associations[:, 0] >= 0)
    assert repeated.any() == (not distinct)
    assert (candidates.log_mass_not_enumerated == -np.inf).all()


def test_what_the_gate_leaves_out_is_reported() -> None:
    """A gate of 2 nats keeps few candidates; kept and reported mass together are about the whole."""
    whole = candidates_of_a_pair()
    gated = candidates_of_a_pair(weights={"gate": 2.0})
    assert len(gated.ids) < len(whole.ids)
    log_whole = np.logaddexp.reduce(whole.log_weights)
    log_gated = np.logaddexp.reduce([*gated.log_weights, *gated.log_mass_not_enumerated])
    assert np.isfinite(gated.log_mass_not_enumerated).all()
    assert log_gated == pytest.approx(log_whole, abs=1.0)


def test_classes_are_enumerated_for_objects_that_were_not_seen_before() -> None:
    """Two new objects of two classes each; the class prior is part of the weight."""
    candidates = candidates_of_a_pair(**NOTHING_WRONG)
    assert len(candidates.ids) == 5 * 4 * 2 * 2
    assert set(map(tuple, candidates.class_assignments)) == {(0, 0), (0, 1), (1, 0), (1, 1)}


@pytest.mark.slow
def test_objects_of_unknown_heading_do_not_lose_the_truth() -> None:
    """The map says nothing of headings, and its means are wrong by anything: every mode of the heading is searched."""
    world = make_world(10, sigma_start_m=0.3, sigma_heading_rad=3.0)
    manager = Engine.of_run(world.run, InProcessPool(1))
    for keyframe in world.keyframes:
        belief = manager.process(keyframe)
    assert np.hypot(*(belief.poses[0, :2] - world.truth[-1, :2])) < 0.6
    best = max(manager.live.values(), key=lambda live: live.log_weight)
    assert [step.association for step in best.lineage] == world.associations


def with_prior(world: World, **changes: object) -> World:
    """The same world, with the first object of the map prior changed."""
    prior = parse_map_prior(world.run.map_prior, "test")
    first = dataclasses.replace(prior.objects[0], **changes)
    text = MapPrior((first, *prior.objects[1:])).to_json()
    return dataclasses.replace(world, run=dataclasses.replace(world.run, map_prior=text))


def test_what_the_map_prior_says_of_an_object_reaches_the_belief() -> None:
    world = with_prior(make_world(1), existence=0.3, class_probabilities={"class_2": 1.0})
    belief = beliefs(world, 1)[0]
    assert belief.existence[0] == pytest.approx(0.3)
    unseen = 0 not in world.associations[0]
    assert not unseen or 0.0 < belief.class_probabilities[0, 0] < 0.01


def test_a_class_of_the_map_prior_that_nobody_knows_is_refused() -> None:
    world = with_prior(make_world(1), class_probabilities={"clas_1": 0.7, "class_2": 0.3})
    with pytest.raises(InputError, match="unknown class 'clas_1'"):
        Engine.of_run(world.run, InProcessPool(1))
