"""Pictures on the faces of the simulated furniture, drawn with OpenCV.

Every picture is seeded by its own name, so that adding one never changes another. Pictures are (SIZE, SIZE, 3) RGB,
upper left corner first, as somebody standing in front of the face sees them.
"""

import hashlib
from collections.abc import Callable
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

SIZE = 256

WOOD: Colour = (168, 124, 80)
DARK_WOOD: Colour = (92, 62, 42)
PAINT: Colour = (150, 160, 166)
IRON: Colour = (52, 54, 60)
BRASS: Colour = (214, 172, 74)


def generator(name: str) -> np.random.Generator:
    """Random numbers that depend on ``name`` alone."""
    return np.random.default_rng(int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big"))


def draw(name: str) -> Picture:
    """The picture of that name; see ``PICTURES``."""
    return PICTURES[name](generator(name))


def planks(rng: np.random.Generator, colour: Colour, count: int, upright: bool) -> Picture:
    """Boards with grain and dark joints, upright or lying."""
    picture = np.empty((SIZE, SIZE, 3))
    edges = np.linspace(0, SIZE, count + 1).astype(int)
    for start, end in pairwise(edges):
        shade = rng.uniform(0.82, 1.12)
        grain = cv2.GaussianBlur(rng.normal(0.0, 1.0, (end - start, SIZE)), (0, 0), sigmaX=22.0, sigmaY=0.9)
        grain *= 9.0 / max(float(grain.std()), 1e-9)
        picture[start:end] = np.asarray(colour) * shade + grain[..., None]
        cv2.line(picture, (0, start), (SIZE, start), [value * 0.35 for value in colour], 4)
    board = np.clip(picture, 0, 255).astype(np.uint8)
    return np.ascontiguousarray(board.transpose(1, 0, 2)) if upright else board


def sheet(rng: np.random.Generator, colour: Colour) -> Picture:
    """Painted sheet metal with a faint unevenness."""
    cloud = cv2.GaussianBlur(rng.normal(0.0, 1.0, (SIZE, SIZE)), (0, 0), sigmaX=18.0)
    cloud *= 4.0 / max(float(cloud.std()), 1e-9)
    picture = np.asarray(colour) + cloud[..., None] + rng.normal(0.0, 1.5, (SIZE, SIZE, 1))
    return np.asarray(np.clip(picture, 0, 255), dtype=np.uint8)


def frame(picture: Picture, colour: Colour, width: int) -> Picture:
    """A border on the picture."""
    cv2.rectangle(picture, (0, 0), (SIZE - 1, SIZE - 1), colour, 2 * width)
    return picture


def bar(picture: Picture, start: tuple[int, int], end: tuple[int, int], colour: Colour, width: int) -> None:
    """A board or band between two points, with dark edges."""
    cv2.line(picture, start, end, tuple(int(value * 0.4) for value in colour), width + 6)
    cv2.line(picture, start, end, colour, width)


def crate_front(rng: np.random.Generator) -> Picture:
    """Light boards behind a frame with a cross of two beams."""
    picture = planks(rng, (214, 176, 120), 6, upright=False)
    bar(picture, (10, 10), (246, 246), (232, 200, 148), 28)
    bar(picture, (246, 10), (10, 246), (232, 200, 148), 28)
    return frame(picture, (196, 150, 92), 16)


def crate_side(rng: np.random.Generator) -> Picture:
    """Boards with one beam and a stencilled arrow."""
    picture = planks(rng, WOOD, 5, upright=False)
    bar(picture, (10, 246), (246, 10), (206, 168, 112), 26)
    cv2.arrowedLine(picture, (70, 130), (70, 40), (40, 30, 28), 10, tipLength=0.4)
    return picture


def chest_front(rng: np.random.Generator) -> Picture:
    """Dark boards, a lid line, iron bands and a large brass lock."""
    picture = planks(rng, DARK_WOOD, 4, upright=False)
    cv2.rectangle(picture, (0, 74), (SIZE, 86), (24, 18, 14), -1)
    for x in (52, 204):
        bar(picture, (x, 0), (x, SIZE), IRON, 26)
        for y in range(20, SIZE, 36):
            cv2.circle(picture, (x, y), 5, (150, 150, 150), -1)
    cv2.rectangle(picture, (100, 62), (156, 140), BRASS, -1)
    cv2.circle(picture, (128, 96), 9, (30, 22, 16), -1)
    cv2.rectangle(picture, (124, 96), (132, 124), (30, 22, 16), -1)
    return frame(picture, (60, 42, 30), 5)


def chest_side(rng: np.random.Generator) -> Picture:
    """Boards with an iron band and a ring to lift the chest by."""
    picture = planks(rng, WOOD, 5, upright=False)
    bar(picture, (128, 0), (128, SIZE), IRON, 30)
    cv2.circle(picture, (128, 128), 42, IRON, 12)
    return picture


def desk_front(rng: np.random.Generator) -> Picture:
    """A dark knee hole on the left, three drawers with round knobs on the right."""
    picture = planks(rng, (196, 136, 84), 5, upright=False)
    cv2.rectangle(picture, (14, 46), (118, SIZE), (34, 26, 22), -1)
    for row in range(3):
        top = 48 + row * 68
        cv2.rectangle(picture, (134, top), (242, top + 58), (224, 176, 120), -1)
        cv2.rectangle(picture, (134, top), (242, top + 58), (92, 60, 36), 5)
        cv2.circle(picture, (188, top + 29), 11, (44, 38, 34), -1)
    return picture


def cabinet_front(rng: np.random.Generator) -> Picture:
    """Two white doors with long handles."""
    picture = sheet(rng, (226, 228, 224))
    cv2.line(picture, (128, 0), (128, SIZE), (64, 70, 76), 8)
    for x in (28, 152):
        cv2.rectangle(picture, (x, 34), (x + 76, 222), (178, 184, 186), 6)
    for x in (106, 150):
        cv2.line(picture, (x, 88), (x, 168), (40, 44, 50), 10)
    return frame(picture, (120, 128, 134), 7)


def cabinet_side(rng: np.random.Generator) -> Picture:
    """Painted sheet with two open shelves."""
    picture = sheet(rng, PAINT)
    for top in (40, 140):
        cv2.rectangle(picture, (40, top), (216, top + 72), (78, 84, 90), -1)
        cv2.line(picture, (40, top + 72), (216, top + 72), (214, 218, 220), 6)
    return picture


def locker_front(rng: np.random.Generator) -> Picture:
    """A teal door with louvres, a number plate and a padlock."""
    picture = sheet(rng, (44, 122, 118))
    for y in (34, 54, 74, 186, 206, 226):
        cv2.line(picture, (62, y), (194, y), (16, 58, 58), 8)
    cv2.rectangle(picture, (88, 100), (168, 146), (240, 236, 214), -1)
    cv2.putText(picture, "27", (96, 140), cv2.FONT_HERSHEY_SIMPLEX, 1.5, (30, 30, 30), 5)
    cv2.circle(picture, (216, 132), 14, BRASS, -1)
    return frame(picture, (24, 84, 82), 6)


def locker_side(rng: np.random.Generator) -> Picture:
    """Painted sheet with a diagonal warning stripe."""
    picture = sheet(rng, PAINT)
    for offset in range(-SIZE, 2 * SIZE, 64):
        corners = np.array([[offset, 160], [offset + 32, 160], [offset + 72, 96], [offset + 40, 96]])
        cv2.fillPoly(picture, [corners], (222, 176, 40))
    return picture


def floor(rng: np.random.Generator) -> Picture:
    """Stone tiles."""
    picture = sheet(rng, (138, 134, 128))
    for at in (0, SIZE // 2):
        cv2.line(picture, (at, 0), (at, SIZE), (112, 108, 102), 3)
        cv2.line(picture, (0, at), (SIZE, at), (112, 108, 102), 3)
    return picture


def wall(rng: np.random.Generator) -> Picture:
    """Plaster above a skirting board."""
    picture = sheet(rng, (206, 202, 190))
    cv2.rectangle(picture, (0, 236), (SIZE, SIZE), (120, 112, 104), -1)
    return picture


PICTURES: dict[str, Callable[[np.random.Generator], Picture]] = {
    "crate_front": crate_front,
    "crate_side": crate_side,
    "chest_front": chest_front,
    "chest_side": chest_side,
    "desk_front": desk_front,
    "cabinet_front": cabinet_front,
    "cabinet_side": cabinet_side,
    "locker_front": locker_front,
    "locker_side": locker_side,
    "planked_back": lambda rng: planks(rng, WOOD, 6, upright=True),
    "planked_side": lambda rng: planks(rng, WOOD, 5, upright=False),
    "planked_top": lambda rng: planks(rng, (150, 110, 72), 7, upright=False),
    "plain_back": lambda rng: frame(sheet(rng, PAINT), (118, 128, 134), 5),
    "plain_side": lambda rng: sheet(rng, PAINT),
    "plain_top": lambda rng: sheet(rng, (132, 142, 148)),
    "floor": floor,
    "wall": wall,
}
