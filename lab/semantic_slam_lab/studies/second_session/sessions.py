"""Two sessions in one room, and what the difference of their maps says."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.maps.as_prior import map_prior_of
from semantic_slam.maps.comparison import Comparison
from semantic_slam.maps.differences import MapDifference, difference
from semantic_slam.maps.from_run import saved_map_of_engine
from semantic_slam.maps.map_file import with_id
from semantic_slam.maps.saved_map import SavedMap
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.studies.aliased_room.data import Recording, record_scene
from semantic_slam_lab.studies.second_session.changes import Change, changed

SURVEY_SIGMA = np.array([0.2236, 0.2236, 0.0224])
"""Standard deviations of the first session's map, x, y [m], yaw [rad], as in the shipped bag; it knows no classes."""
LOST_SIGMA, KNOWN_SIGMA = np.array([10.0, 10.0, 0.2]), np.array([0.1, 0.1, 0.05])
STARTS = ("known_start", "lost_on_map", "lost")
"""Where the second session begins: at its place on the map, lost on it, or wherever it is, without the map."""
NEAR_M = 0.4
"""What stands nearer than that to the truth is it."""
STATED = 0.5


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What was said of a second session; probabilities of what is true of each thing that changed."""

    displaced: tuple[float, float]
    gone: float
    new: float
    wrong: int  # things that are said besides, or of another place
    place_error_m: float | None  # of the displaced ones in the new map, the larger one; None: not both are there

    @property
    def least(self) -> float:
        """Probability of the least sure one."""
        return min(*self.displaced, self.gone, self.new)


def sessions(number: int, seed: int) -> dict[str, Judged]:
    """In the room of a number: the second one starting at its place on the map, or lost, with the map and without."""
    change = changed(number)
    before, after = record_scene(number), record_scene(number, objects=change.objects)
    random = np.random.default_rng([number, seed, 32])
    old = _map(before, Configuration(), _survey(before, random), _start(before, LOST_SIGMA, random), LOST_SIGMA)
    on_map, without = (load_configuration(configuration_file(name)) for name in ("second_session", "open_world"))
    here = _map(after, on_map, map_prior_of(old), _start(after, KNOWN_SIGMA, random), KNOWN_SIGMA)
    anywhere = _start(after, LOST_SIGMA, random)
    found = _found_on(old, after, on_map, anywhere)
    lost = _map(after, without, None, anywhere, LOST_SIGMA)
    return {
        name: judged_maps(Comparison.of(old, new), change, before)
        for name, new in zip(STARTS, (here, found, lost), strict=True)
    }


def _found_on(old: SavedMap, room: Recording, configuration: Configuration, start: Array) -> SavedMap:
    """The map at the end of a drive that began lost on ``old``; that one itself where the robot did not find itself."""
    try:
        return _map(room, configuration, map_prior_of(old), start, LOST_SIGMA)
    except InputError:
        return old


def _survey(room: Recording, random: np.random.Generator) -> MapPrior:
    drawn = room.objects + SURVEY_SIGMA * random.normal(size=room.objects.shape)
    rows = zip(room.object_ids, drawn.tolist(), strict=True)
    return MapPrior(
        tuple(ObjectPrior.planar(int(n), *pose, sigma_m=SURVEY_SIGMA[0], sigma_rad=SURVEY_SIGMA[2]) for n, pose in rows)
    )


def _start(room: Recording, sigma: Array, random: np.random.Generator) -> Array:
    return np.asarray(room.truth[0] + sigma * random.normal(size=3))


def _map(room: Recording, configuration: Configuration, prior: MapPrior | None, start: Array, sigma: Array) -> SavedMap:
    """The map at the end of a drive."""
    engine = Engine(configuration, prior, initial_pose=start, initial_covariance=np.diag(sigma**2))
    assert isinstance(engine.pool, InProcessPool)
    for keyframe in room.keyframes:
        belief = engine.process(keyframe)
    return with_id(saved_map_of_engine(engine, engine.pool, belief))


def judged_maps(told: Comparison, change: Change, before: Recording) -> Judged:
    """What the difference of two maps says, against the truth."""
    numbers = told.new.objects.ids[told.theirs.rows].tolist()
    return judged(difference(told), dict(zip(numbers, told.new_positions, strict=True)), change, before)


def judged(told: MapDifference, places: Mapping[int, Array], change: Change, before: Recording) -> Judged:
    """A difference against the truth; ``places`` (2,) are those of the new map's objects in the old map's frame."""
    now = {own.object_id: np.array([own.x_m, own.y_m]) for own in change.objects}
    rows = {own.object_id: own for own in told.old}
    found = {n: rows[n].new_id for n in sorted(change.moved)}
    errors = [np.inf if own is None else float(np.hypot(*(places[own] - now[n]))) for n, own in found.items()]
    kept = {int(n) for n in before.object_ids} - change.moved - {change.gone}
    wrong = sum(rows[n].kind != "same" for n in kept)
    wrong += sum(not error < NEAR_M for error in errors)
    news = [own for own in told.new if own.probability >= STATED]
    right = [own for own in news if np.hypot(*(own.position - now[change.new])) < NEAR_M]
    return Judged(
        displaced=tuple(rows[n].probabilities["displaced"] for n in sorted(change.moved)),  # type: ignore[arg-type]
        gone=rows[change.gone].probabilities["gone"],
        new=max((own.probability for own in right), default=0.0),
        wrong=int(wrong) + len(news) - min(len(right), 1),
        place_error_m=max(errors) if np.isfinite(errors).all() else None,
    )
