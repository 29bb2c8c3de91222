"""A path through a scene's move graph: from a file, or a tour past all objects."""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from semantic_slam.datasets.avd.scene import MOVES, AvdScene
from semantic_slam.errors import InputError

LEAST_TOUR_FRAMES = 60
MOST_TOUR_FRAMES = 400
VIEWS_PER_OBJECT = 5


@dataclass(frozen=True)
class Stop:
    """An image on the path; only keyframes deliver pictures and detections, the others odometry alone."""

    name: str
    keyframe: bool


def read_path(scene: AvdScene, path: Path) -> tuple[Stop, ...]:
    """Image names and moves, one per line; names that are not adjacent are connected by the fewest moves.

    Raises InputError that names the line.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}; name a file of image names and moves") from None
    stops: list[Stop] = []
    for number, line in enumerate(lines, start=1):
        if word := line.split("#")[0].strip():
            stops += _continue(scene, stops, word, f"{path}:{number}")
    if not stops:
        raise InputError(f"{path}: empty; write one image name or move per line")
    return tuple(stops)


def _continue(scene: AvdScene, stops: list[Stop], word: str, origin: str) -> list[Stop]:
    here = scene.images[stops[-1].name] if stops else None
    if word in MOVES:
        if here is None:
            raise InputError(f"{origin}: the path starts with a move; start with the name of an image")
        if word not in here.moves:
            raise InputError(f"{origin}: nothing lies '{word}' of {here.name}; possible: {', '.join(here.moves)}")
        return [Stop(here.moves[word], True)]
    if word not in scene.images:
        raise InputError(f"{origin}: '{word}' is neither a move nor an image with a pose in {scene.folder}")
    if here is None or word == here.name:
        return [Stop(word, True)]
    between = fewest_moves(scene, here.name, lambda name: name == word)
    if between is None:
        raise InputError(f"{origin}: no moves lead from {here.name} to {word}; name images that moves connect")
    return [*(Stop(name, False) for name in between[:-1]), Stop(word, True)]


def fewest_moves(scene: AvdScene, start: str, reached: Callable[[str], bool]) -> list[str] | None:
    """Images after ``start`` up to the nearest one that ``reached`` accepts, None when there is none."""
    previous: dict[str, str] = {}
    queue = deque([start])
    while queue:
        name = queue.popleft()
        if name != start and reached(name):
            return _backtrack(previous, start, name)
        for move in MOVES:
            target = scene.images[name].moves.get(move)
            if target is not None and target != start and target not in previous:
                previous[target] = name
                queue.append(target)
    return None


def _backtrack(previous: dict[str, str], start: str, end: str) -> list[str]:
    names = [end]
    while previous[names[-1]] != start:
        names.append(previous[names[-1]])
    return names[::-1]


def automatic_tour(scene: AvdScene, max_difficulty: int) -> tuple[Stop, ...]:
    """Always on to the nearest new image of the object seen least so far, until each was seen often and long enough."""
    shows = {name: _shown(scene, name, max_difficulty) for name in scene.images}
    seen: Counter[int] = Counter(dict.fromkeys(set().union(*shows.values()), 0))
    start = next((name for name, ids in shows.items() if ids), None)
    if start is None:
        raise InputError(
            f"{scene.folder}: no image shows an object of difficulty {max_difficulty} or less; raise --max-difficulty"
        )
    names, wanted = [start], Counter(shows[start])
    seen.update(wanted)
    while len(names) < MOST_TOUR_FRAMES and (len(names) < LEAST_TOUR_FRAMES or min(seen.values()) < VIEWS_PER_OBJECT):
        leg = _leg(scene, names, shows, seen)
        if leg is None:
            break
        names += leg
        for name in leg:
            seen.update(shows[name])
    return tuple(Stop(name, True) for name in names)


def _leg(scene: AvdScene, names: list[str], shows: dict[str, frozenset[int]], seen: Counter[int]) -> list[str] | None:
    """Moves to the nearest image, not visited before, of the rarest object that can be reached."""
    visited = set(names)
    for rarest in sorted(seen, key=lambda number: (seen[number], number)):
        leg = fewest_moves(scene, names[-1], lambda name, rarest=rarest: name not in visited and rarest in shows[name])  # type: ignore[misc]
        if leg is not None:
            return leg
    return None


def _shown(scene: AvdScene, name: str, max_difficulty: int) -> frozenset[int]:
    image = scene.images[name]
    return frozenset(image.instance_ids[image.difficulties <= max_difficulty].tolist())
