"""Three objects of the shipped room explained: every account adds up, and says why look-alikes were told apart."""

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from semantic_slam.answers.explain.explanation import Explanation, explanation_of
from semantic_slam.answers.explain.replayed_run import replay
from semantic_slam.answers.explain.text import lines_of
from semantic_slam.configuration import load_configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.pipeline.recorded_keyframes import recorded_keyframes

ROOT = Path(__file__).parents[2]
RIVALS = {1: ("cabinet", "locker"), 5: ("desk", "chest"), 7: ("locker", "cabinet")}
"""Class of an object, and the one that looks most like it."""
RATIO = 150.0

pytestmark = pytest.mark.slow


def explained(bag: Path, num_keyframes: int) -> dict[int, Explanation]:
    configuration = load_configuration(ROOT / "config" / "default.yaml")
    run_bag(ROOT / "bags" / "aliased_room", bag, configuration, max_keyframes=num_keyframes)
    record = read_record(bag)
    run = replay(record, recorded_keyframes(bag, configuration, num_keyframes), list(RIVALS))
    return {number: explanation_of(record, run, number) for number in RIVALS}


@pytest.fixture(scope="module")
def early(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Explanation]:
    """While it is open which objects were seen."""
    return explained(tmp_path_factory.mktemp("early") / "belief", 2)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Explanation]:
    return explained(tmp_path_factory.mktemp("late") / "belief", 38)


@pytest.mark.long
def test_of_every_history_and_pair_of_classes_prior_views_and_revision_are_the_log_odds(
    early: dict[int, Explanation], late: dict[int, Explanation]
) -> None:
    assert all(len(own.histories) > 1 for own in early.values())
    for own in (*early.values(), *late.values()):
        assert own.run.is_same
        for history in own.histories:
            for one, other in permutations(range(len(history.ledger.log_prior)), 2):
                pair = history.ledger.pair(one, other)
                assert pair.prior + np.nansum(pair.views) + pair.revised == pytest.approx(pair.log_odds, abs=1e-6)


def test_what_is_believed_of_it_is_the_mean_of_its_histories_by_their_weights(
    early: dict[int, Explanation], late: dict[int, Explanation]
) -> None:
    for own in (*early.values(), *late.values()):
        weights = np.array([history.weight for history in own.histories])
        given = np.exp([history.ledger.log_posterior for history in own.histories])
        stated = own.belief.class_probabilities[own.belief.object_ids.tolist().index(own.object_id)]
        assert weights.sum() == pytest.approx(1.0, abs=1e-6)
        np.testing.assert_allclose(weights @ given, stated, atol=1e-6)


def test_the_class_that_looks_most_like_it_is_told_with_its_last_odds_and_when_it_went(
    late: dict[int, Explanation],
) -> None:
    for number, names in RIVALS.items():
        own, pair = late[number], late[number].histories[0].pair
        assert own.classes is not None and pair is not None
        assert tuple(own.belief.class_names[cls] for cls in own.classes) == names
        assert pair.is_pruned and pair.gone == pair.log_odds + pair.last_nats > np.log(RATIO)
        told = (
            f"object_{number} is of class {names[0]} with probability 1.0000. Class {names[1]} was dropped in keyframe"
        )
        odds = f"{pair.until + 1}, at log odds of +{pair.gone:.2f} nats of {names[0]} against {names[1]}."
        assert lines_of(own)[0] == f"{told} {odds}"


def test_the_desk_is_told_from_a_chest_by_the_first_view_of_its_front(late: dict[int, Explanation]) -> None:
    best, pair = late[5].histories[0], late[5].histories[0].pair
    assert pair is not None
    before = pair.views[np.isfinite(pair.views)]
    assert len(before) == 3 and np.abs(before).max() < 0.2  # from its back the two are alike
    assert pair.until + 1 == 36 and pair.last_nats > 4.5
    assert 280.0 < np.rad2deg(best.views[3].direction_rad) % 360.0 < 320.0
