"""Maps that have nothing in common are not aligned; the odds are those of integrals over alignments and matchings."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.maps.alignments import aligned
from semantic_slam.maps.as_prior import saved_map_of_prior
from semantic_slam.maps.common_place import log_odds_of_one_place
from semantic_slam.maps.comparison import LEAST_UNSEEN, Comparison
from semantic_slam.maps.correspondence import Correspondence
from semantic_slam.maps.landmarks import Landmarks, compared_rows
from semantic_slam.maps.map_file import with_id
from semantic_slam.maps.merging import merged
from semantic_slam.maps.saved_map import SavedMap

NAMES = ("chair", "desk", "lamp", "plant")
SIGMA_M, SIGMA_RAD, UNKNOWN_RAD = 0.05, 0.1, 3.0


def furnished(
    places: np.ndarray, classes: np.ndarray | None = None, *, first: int = 0, sigma_rad: float = SIGMA_RAD
) -> SavedMap:
    """A map of objects at (n, 3) x, y, yaw, or of points in space at x, y, z where ``sigma_rad`` is 0."""
    shares = [{}] * len(places)  # type: list[dict[str, float]]
    if classes is not None:
        shares = [{name: (0.97 if k == own else 0.01) for k, name in enumerate(NAMES)} for own in classes.tolist()]
    objects = [
        ObjectPrior.planar(first + n, *place, sigma_m=SIGMA_M, sigma_rad=sigma_rad, class_probabilities=share)
        if sigma_rad
        else replace(ObjectPrior.point(first + n, place, sigma_m=SIGMA_M), class_probabilities=share)
        for n, (place, share) in enumerate(zip(places.tolist(), shares, strict=True))
    ]
    space = "planar" if sigma_rad else "spatial"
    return with_id(saved_map_of_prior(MapPrior(tuple(objects), state_space=space)))


def with_existence(known: SavedMap, existence: list[float]) -> SavedMap:
    return with_id(replace(known, objects=replace(known.objects, existence=np.array(existence))))


def landmarks(known: SavedMap) -> Landmarks:
    return Landmarks.of(known, known.class_names, compared_rows(known))


def log_absent_of(old: Landmarks) -> np.ndarray:
    return np.asarray(np.log(1.0 - old.existence + old.existence * (0.05 + LEAST_UNSEEN)))


def motions_near(found: Correspondence, count: int = 31, width: float = 7.0) -> tuple[np.ndarray, float]:
    """Alignments (K, 3) on a grid of ``width`` standard deviations about the estimate, and the volume of a cell."""
    values, axes = np.linalg.eigh(found.alignment.covariance)
    steps = np.linspace(-width, width, count)
    grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    errors, centre = (grid * np.sqrt(values)) @ axes.T, found.alignment.centre
    cos, sin = np.cos(errors[:, 2]), np.sin(errors[:, 2])
    turned = np.stack([cos * centre[0] - sin * centre[1], sin * centre[0] + cos * centre[1]], axis=1)
    about = np.column_stack([centre + errors[:, :2] - turned, errors[:, 2]])
    T = se2.compose(about, np.broadcast_to(found.alignment.T_old_new, about.shape))
    return T, float(np.prod(np.sqrt(values)) * (2.0 * width / (count - 1)) ** 3)


def normal(offset: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    squared = np.einsum("ka,ab,kb->k", offset, np.linalg.inv(covariance), offset)
    return np.asarray(np.exp(-0.5 * squared) / np.sqrt(np.linalg.det(2.0 * np.pi * covariance)))


def densities(old: Landmarks, new: Landmarks, T: np.ndarray) -> np.ndarray:
    """(K, n, m) densities of each new object's place and heading, given the old one that it is: stayed or displaced."""
    found = np.zeros((len(T), len(old), len(new)))
    for i, j in product(range(len(old)), range(len(new))):
        offset = se2.compose(T, np.broadcast_to(new.states[j], T.shape)) - old.states[i]
        offset[:, 2] = (offset[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        turn = old.frames.turn(T[len(T) // 2])
        total = old.covariances[i] + turn @ new.covariances[j] @ turn.T + 0.03**2 * np.eye(3)
        heading = 0.98 * normal(offset[:, 2:], total[2:, 2:]) + 0.02 / (2.0 * np.pi)
        stayed = normal(offset[:, :2], total[:2, :2]) * heading
        moved = sum(normal(offset[:, :2], total[:2, :2] + sigma**2 * np.eye(2)) for sigma in (0.3, 1.0, 3.0)) / 3.0
        found[:, i, j] = 0.9 * stayed + 0.05 * moved / (2.0 * np.pi)
    return found


def matchings(count: int, size: int) -> Iterator[tuple[int, ...]]:
    """All ways of giving each of ``count`` old objects one of ``size`` new ones, each at most once, or none (-1)."""
    for own in product(range(-1, size), repeat=count):
        taken = [j for j in own if j >= 0]
        if len(taken) == len(set(taken)):
            yield own


def exact_log_odds(old: Landmarks, new: Landmarks, found: Correspondence, area: float, steps: int = 80) -> float:
    """By sums over matchings, a grid of alignments, and the shares that both maps hold; new objects surely exist."""
    T, cell = motions_near(found)
    likelihoods, middles = densities(old, new, T), (np.arange(steps) + 0.5) / steps
    q, r = np.meshgrid(middles, middles, indexing="ij")
    count, per_m2 = old.existence.sum(), old.existence.sum() / area
    one = np.zeros_like(q)
    for own in matchings(len(old), len(new)):
        pairs = [(i, j) for i, j in enumerate(own) if j >= 0]
        over_alignments = np.prod([likelihoods[:, i, j] for i, j in pairs], axis=0) * np.ones(len(T))
        weight = over_alignments.sum() * cell / (2.0 * np.pi * area) * np.ones_like(q)
        for i, j in enumerate(own):
            weight *= old.existence[i] * r if j >= 0 else 1.0 - 0.95 * old.existence[i] * r
        others = 0.05 + (1.0 - q) / q
        one += weight * (r * others * per_m2 / (2.0 * np.pi)) ** (len(new) - len(pairs)) * np.exp(-r * others * count)
    elsewhere = (r / q * per_m2 / (2.0 * np.pi)) ** len(new) * np.exp(-r / q * count)
    return float(np.log(one.sum()) - np.log(elsewhere.sum()))


CORNERS = np.array([[0.0, 0.0, 0.3], [5.0, 0.0, -2.0], [5.0, 4.0, 1.1], [0.0, 4.0, 2.2]])
NOISE = np.array([[0.03, -0.05, 0.06], [-0.04, 0.02, 0.03], [0.05, 0.04, -0.08], [0.02, 0.01, 0.02]])
T_OLD_NEW = np.array([1.5, -2.0, 0.0])


@pytest.mark.parametrize(
    ("ours", "theirs", "existence"),
    [
        ([0], [0], [1.0]),
        ([0, 2], [0, 2], [1.0, 1.0]),
        ([0, 1, 2], [0, 2], [1.0, 0.7, 0.9]),
        ([0, 2], [0, 1, 2], [0.8, 0.9]),
        ([0, 2, 3], [0, 1, 2], [0.8, 0.9, 1.0]),
    ],
)
def test_the_odds_are_those_of_all_alignments_matchings_and_shares(
    ours: list[int], theirs: list[int], existence: list[float]
) -> None:
    """Both maps reach over one rectangle, whose corners are the first and the last object."""
    seen = se2.between(np.broadcast_to(T_OLD_NEW, (4, 3)), CORNERS + NOISE)
    old = landmarks(with_existence(furnished(CORNERS[ours]), existence))
    new = landmarks(furnished(seen[theirs], first=20))
    _, found = max(aligned(old, new, log_absent_of(old)).of_one_place, key=lambda own: own[0])
    low, high = CORNERS[ours, :2].min(axis=0) - 2.0, CORNERS[ours, :2].max(axis=0) + 2.0
    exact = exact_log_odds(old, new, found, float(np.prod(high - low)))
    assert log_odds_of_one_place(old, new, log_absent_of(old), found) == pytest.approx(exact, abs=0.03)


KINDS = {"headings": SIGMA_RAD, "points": UNKNOWN_RAD, "space": 0.0}


def drawn(random: np.random.Generator, sigma_rad: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) and classes (n,) in a room of 8 m x 8 m."""
    high = np.array([4.0, 4.0, np.pi if sigma_rad else 1.2])
    return random.uniform(-high, high, (count, 3)), random.integers(len(NAMES), size=count)


@pytest.mark.long
@pytest.mark.parametrize("kind", sorted(KINDS))
@pytest.mark.parametrize("has_classes", [True, False])
def test_rooms_drawn_apart_are_refused_and_one_with_half_of_its_things_exchanged_is_not(
    kind: str, has_classes: bool
) -> None:
    """Four pairs of rooms with eight objects each, of which none, or five, are the same."""
    for seed in range(4):
        random = np.random.default_rng([seed, 8, int(has_classes)])
        (ours, classes), (theirs, others) = (drawn(random, KINDS[kind], 8) for _ in range(2))
        old = furnished(ours, classes if has_classes else None, sigma_rad=KINDS[kind])
        apart = furnished(theirs, others if has_classes else None, first=20, sigma_rad=KINDS[kind])
        with pytest.raises(InputError, match="too little in common"):
            Comparison.of(old, apart)
        theirs[:5], others[:5] = ours[:5], classes[:5]
        again = furnished(theirs, others if has_classes else None, first=20, sigma_rad=KINDS[kind])
        told = Comparison.of(old, again)
        assert told.alignment_probability > 0.99
        assert (np.diagonal(told.same)[:5] > 0.5).all()


def test_one_object_of_each_map_does_not_tell_that_they_are_of_one_place() -> None:
    """Its heading gives an alignment, of which nothing else says that it is true."""
    one, other = (furnished(CORNERS[n : n + 1], np.array([0]), first=n) for n in (0, 1))
    for compare in (Comparison.of, lambda *maps: merged(*maps, "test")):
        with pytest.raises(InputError, match="--same-frame if they are of one frame"):
            compare(one, other)
    assert Comparison.of(one, other, same_frame=True).one_place == 1.0


def test_a_corner_of_a_large_map_is_found_on_it() -> None:
    """What lies where the other map does not reach is no evidence against one place."""
    places = np.array([[3.0 * x, 3.5 * y, 0.7 * x - 1.1 * y] for x in range(5) for y in range(4)])
    places[:, :2] += np.random.default_rng(2).uniform(-0.8, 0.8, (len(places), 2))
    near = np.flatnonzero((places[:, :2] < 5.0).all(axis=1))
    corner = se2.between(np.broadcast_to(T_OLD_NEW, (len(near), 3)), places[near])
    whole, part = furnished(places), furnished(corner, first=40)
    for pair in ((whole, part), (part, whole)):
        assert Comparison.of(*pair).alignment_probability > 0.99
