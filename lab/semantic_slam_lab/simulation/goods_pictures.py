"""Pictures on the goods: each class has its manner, each instance its colours, letters and ornaments.

Pictures are named ``<instance>/<side>``. Those wrapped around a solid of revolution are four sides in a row: back
half, right, front, left, back half, as ``surface.revolved`` lays them.
"""

import colorsys
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from semantic_slam_lab.simulation.goods import goods_class
from semantic_slam_lab.simulation.textures import IRON, SIZE, Colour, Picture, bar, frame, generator, planks, sheet

LETTERS = "ABCDEFGHKLMNPRSTUVXYZ"


@dataclass(frozen=True)
class Livery:
    """What all sides of an instance share."""

    body: Colour
    accent: Colour
    ink: Colour
    word: str


def goods_picture(name: str) -> Picture:
    """The picture of one side of an instance; raises KeyError."""
    instance, side = name.split("/")
    class_name = goods_class(instance)
    livery = _livery(instance, class_name)
    painter = PAINTERS[class_name]
    if side == "wrap":
        return _wrapped([painter(generator(f"{instance}/{part}"), part, livery) for part in SIDES])
    return painter(generator(name), side, livery)


SIDES = ("right", "front", "left", "back")
"""Sides from left to right for who walks around an object counter-clockwise seen from above, looking at it."""


def _wrapped(sides: list[Picture]) -> Picture:
    """(SIZE, 4 SIZE, 3); the back is cut in two halves."""
    right, front, left, back = sides
    half = SIZE // 2
    return np.ascontiguousarray(np.concatenate([back[:, half:], right, front, left, back[:, :half]], axis=1))


def _livery(instance: str, class_name: str) -> Livery:
    """Hues of an instance scatter about its class's."""
    rng = generator(f"{instance}/livery")
    hue, saturation, value = HUES[class_name]
    body = _colour(hue + rng.normal(0.0, 0.1), saturation * rng.uniform(0.5, 1.25), value * rng.uniform(0.65, 1.2))
    accent = _colour(rng.uniform(), rng.uniform(0.5, 0.95), rng.uniform(0.5, 0.95))
    ink = (28, 26, 30) if sum(body) > 330 else (236, 232, 224)
    return Livery(body, accent, ink, "".join(rng.choice(list(LETTERS), 3)))


def _colour(hue: float, saturation: float, value: float) -> Colour:
    red, green, blue = colorsys.hsv_to_rgb(hue % 1.0, min(saturation, 1.0), min(value, 1.0))
    return int(255 * red), int(255 * green), int(255 * blue)


HUES = {
    "barrel": (0.07, 0.55, 0.62),
    "bin": (0.36, 0.6, 0.55),
    "cooler": (0.55, 0.65, 0.85),
    "drum": (0.62, 0.75, 0.7),
    "engine": (0.13, 0.7, 0.85),
    "parcel": (0.09, 0.45, 0.78),
    "speaker": (0.7, 0.3, 0.36),
    "vendor": (0.98, 0.75, 0.8),
}
"""Hue, saturation and value of a class's bodies."""


def _write(picture: Picture, text: str, at: tuple[int, int], size: float, colour: Colour) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, max(int(3.2 * size), 2))


def _lines(picture: Picture, rng: np.random.Generator, box: tuple[int, int, int, int], colour: Colour) -> None:
    """Text too small to read."""
    left, top, right, bottom = box
    for y in range(top, bottom, 16):
        cv2.line(picture, (left, y), (left + int((right - left) * rng.uniform(0.4, 1.0)), y), colour, 5)


def _emblem(picture: Picture, rng: np.random.Generator, centre: tuple[int, int], radius: int, colour: Colour) -> None:
    """A disc, a star of some points or a ring."""
    kind = rng.integers(3)
    if kind == 0:
        cv2.circle(picture, centre, radius, colour, -1)
    elif kind == 1:
        turns = np.linspace(0.0, 2.0 * np.pi, 2 * int(rng.integers(3, 8)) + 1)[:-1] - np.pi / 2.0
        reach = radius * np.where(np.arange(len(turns)) % 2 == 0, 1.0, rng.uniform(0.35, 0.6))
        points = np.stack([centre[0] + reach * np.cos(turns), centre[1] + reach * np.sin(turns)], axis=1)
        cv2.fillPoly(picture, [points.astype(np.int32)], colour)
    else:
        cv2.circle(picture, centre, radius, colour, max(radius // 3, 4))


def parcel(rng: np.random.Generator, side: str, livery: Livery) -> Picture:
    """A taped box: an emblem in front, an arrow on the left, a shipping label behind, a stripe on the right."""
    picture = sheet(rng, livery.body)
    tape = int(rng.integers(90, 166))
    if side in ("front", "back", "top"):
        cv2.rectangle(picture, (tape - 16, 0), (tape + 16, SIZE), _shaded(livery.body, 1.2), -1)
    if side == "front":
        _emblem(picture, rng, (int(rng.integers(70, 186)), 112), int(rng.integers(42, 66)), livery.accent)
        _write(picture, livery.word, (60, 236), 2.0, livery.ink)
    elif side == "left":
        x = int(rng.integers(60, 196))
        cv2.arrowedLine(picture, (x, 220), (x, 60), livery.ink, 16, tipLength=0.35)
        _lines(picture, rng, (20, 30, 236, 60), livery.accent)
    elif side == "back":
        left, top = (int(v) for v in rng.integers(16, 90, 2))
        cv2.rectangle(picture, (left, top), (left + 140, top + 110), (240, 238, 232), -1)
        _lines(picture, rng, (left + 14, top + 20, left + 126, top + 100), (40, 40, 40))
    elif side == "right":
        y = int(rng.integers(40, 170))
        cv2.rectangle(picture, (0, y), (SIZE, y + 46), livery.accent, -1)
        _write(picture, livery.word[::-1], (100, y + 38), 1.3, (245, 245, 240))
    return frame(picture, _shaded(livery.body, 0.75), 4)


def vendor(rng: np.random.Generator, side: str, livery: Livery) -> Picture:
    """A vending machine: shelves of wares in front, a word along one side, an ornament on the other, vents behind."""
    picture = sheet(rng, livery.body)
    if side == "front":
        cv2.rectangle(picture, (18, 22), (180, 196), (26, 30, 40), -1)
        for row, column in np.ndindex(4, 5):
            ware = _colour(rng.uniform(), 0.8, 0.9)
            cv2.rectangle(picture, (28 + 30 * column, 32 + 40 * row), (48 + 30 * column, 62 + 40 * row), ware, -1)
        cv2.rectangle(picture, (196, 60), (238, 120), livery.accent, -1)
        cv2.rectangle(picture, (30, 212), (168, 242), (20, 20, 24), -1)
    elif side == "left":
        for place, letter in enumerate(livery.word):
            _write(picture, letter, (96, 84 + 74 * place), 2.4, livery.ink)
    elif side == "right":
        for _ in range(int(rng.integers(3, 6))):
            centre = tuple(int(v) for v in rng.integers(50, 206, 2))
            _emblem(picture, rng, (centre[0], centre[1]), int(rng.integers(20, 50)), livery.accent)
    elif side == "back":
        for y in range(30, 120, 14):
            cv2.line(picture, (40, y), (216, y), (30, 30, 34), 6)
        cv2.rectangle(picture, (60, 160), (150, 230), (190, 190, 186), -1)
    return frame(picture, _shaded(livery.body, 0.6), 6)


def engine(rng: np.random.Generator, side: str, livery: Livery) -> Picture:
    """A machine: gauges in front, vents on the left, a warning sign behind, pipes on the right."""
    picture = sheet(rng, livery.body)
    if side == "front":
        for column in range(int(rng.integers(2, 4))):
            centre = (54 + 74 * column, 86)
            cv2.circle(picture, centre, 34, (236, 236, 230), -1)
            turn = rng.uniform(0.0, 2.0 * np.pi)
            tip = (centre[0] + int(28 * np.cos(turn)), centre[1] + int(28 * np.sin(turn)))
            cv2.line(picture, centre, tip, (200, 30, 30), 6)
        cv2.rectangle(picture, (30, 150), (226, 226), (52, 54, 60), -1)
        _write(picture, livery.word, (70, 212), 1.8, livery.accent)
    elif side == "left":
        for x in range(30, 226, 22):
            cv2.line(picture, (x, 40), (x, 150), (34, 34, 38), 9)
        cv2.rectangle(picture, (30, 180), (int(rng.integers(110, 226)), 226), livery.accent, -1)
    elif side == "back":
        x = int(rng.integers(70, 186))
        corners = np.array([[x, 40], [x - 66, 160], [x + 66, 160]])
        cv2.fillPoly(picture, [corners], (240, 206, 40))
        cv2.polylines(picture, [corners], True, (30, 30, 30), 8)
        _lines(picture, rng, (40, 190, 220, 240), (40, 40, 40))
    elif side == "right":
        for y in rng.integers(30, 226, 3).tolist():
            bar(picture, (0, int(y)), (SIZE, int(y)), IRON, 14)
        cv2.circle(picture, (int(rng.integers(60, 196)), 128), 46, livery.accent, -1)
    return frame(picture, (40, 40, 44), 5)


def cooler(rng: np.random.Generator, side: str, livery: Livery) -> Picture:
    """A box with a white lid: a word in front, a handle on the left, hinges behind, a tap on the right."""
    picture = sheet(rng, livery.body)
    cv2.rectangle(picture, (0, 0), (SIZE, 62), (236, 236, 230), -1)
    if side == "front":
        _write(picture, livery.word, (44, 190), 2.6, livery.ink)
        _emblem(picture, rng, (int(rng.integers(40, 216)), 96), 30, livery.accent)
    elif side == "left":
        bar(picture, (60, 130), (196, 130), (30, 32, 36), 24)
    elif side == "back":
        for x in (60, 196):
            cv2.rectangle(picture, (x - 18, 30), (x + 18, 110), (90, 94, 98), -1)
        _lines(picture, rng, (60, 150, 196, 220), livery.ink)
    elif side == "right":
        cv2.circle(picture, (int(rng.integers(80, 176)), 200), 24, (210, 40, 40), -1)
        y = int(rng.integers(90, 140))
        cv2.rectangle(picture, (0, y), (SIZE, y + 30), livery.accent, -1)
    elif side == "top":
        picture = sheet(rng, (236, 236, 230))
    return frame(picture, _shaded(livery.body, 0.6), 4)


def speaker(rng: np.random.Generator, side: str, livery: Livery) -> Picture:
    """A tall dark box: cones in front, a stripe on the left, sockets behind, a word on the right."""
    picture = sheet(rng, livery.body)
    if side == "front":
        heights = np.linspace(50, 206, int(rng.integers(2, 4)))
        for y in heights.astype(int).tolist():
            radius = int(rng.integers(28, 50))
            cv2.circle(picture, (128, y), radius + 8, (150, 150, 154), -1)
            cv2.circle(picture, (128, y), radius, (30, 30, 32), -1)
            cv2.circle(picture, (128, y), radius // 3, livery.accent, -1)
    elif side == "left":
        start = int(rng.integers(20, 120))
        bar(picture, (0, start), (SIZE, start + 90), livery.accent, 34)
    elif side == "back":
        cv2.rectangle(picture, (60, 120), (196, 230), (170, 172, 176), -1)
        for x in range(80, 190, 32):
            cv2.circle(picture, (x, 180), 10, (200, 40, 30) if rng.random() < 0.5 else (20, 20, 20), -1)
    elif side == "right":
        for place, letter in enumerate(livery.word):
            _write(picture, letter, (100, 84 + 72 * place), 2.0, livery.accent)
    return frame(picture, (16, 16, 18), 6)


def drum(rng: np.random.Generator, side: str, livery: Livery) -> Picture:
    """A steel drum with two rings: a label in front, a hazard sign on the left, text behind, a band on the right."""
    picture = sheet(rng, livery.body)
    if side == "front":
        cv2.rectangle(picture, (40, 60), (216, 190), (238, 236, 228), -1)
        _write(picture, livery.word, (62, 150), 2.0, livery.accent)
    elif side == "left":
        corners = np.array([[128, 56], [200, 128], [128, 200], [56, 128]])
        cv2.fillPoly(picture, [corners], livery.accent)
        cv2.polylines(picture, [corners], True, (240, 240, 236), 8)
    elif side == "back":
        _lines(picture, rng, (40, 100, 216, 170), livery.ink)
    elif side == "right":
        cv2.rectangle(picture, (int(rng.integers(40, 100)), 40), (int(rng.integers(150, 220)), 216), livery.accent, -1)
    for y in (84, 172):
        cv2.line(picture, (0, y), (SIZE, y), _shaded(livery.body, 0.5), 9)
    return picture


def barrel(rng: np.random.Generator, side: str, livery: Livery) -> Picture:
    """Staves with hoops: a branded emblem in front, a tap on the left, letters behind, a painted patch on the right."""
    picture = planks(rng, livery.body, 5, upright=True)
    if side == "front":
        _emblem(picture, rng, (128, 128), int(rng.integers(44, 62)), livery.accent)
    elif side == "left":
        x = int(rng.integers(90, 166))
        cv2.circle(picture, (x, 128), 30, (236, 226, 200), -1)
        bar(picture, (x, 128), (x, 210), (190, 150, 60), 22)
    elif side == "back":
        _write(picture, livery.word, (40, 150), 2.3, (240, 230, 210))
    elif side == "right":
        left, top = (int(v) for v in rng.integers(30, 90, 2))
        cv2.rectangle(picture, (left, top), (left + 120, top + 90), livery.accent, -1)
    for y in (36, 92, 164, 220):
        cv2.line(picture, (0, y), (SIZE, y), IRON, 14)
    return picture


def waste_bin(rng: np.random.Generator, side: str, livery: Livery) -> Picture:
    """A bin with ribs and a dark rim: a sign in front, a slot on the left, stickers behind, a band on the right."""
    picture = sheet(rng, livery.body)
    for x in range(0, SIZE, 32):
        cv2.line(picture, (x, 0), (x, SIZE), _shaded(livery.body, 0.8), 5)
    if side == "front":
        cv2.circle(picture, (128, 140), 62, (240, 240, 236), -1)
        _emblem(picture, rng, (128, 140), 44, livery.accent)
    elif side == "left":
        cv2.rectangle(picture, (50, 70), (206, 110), (20, 22, 24), -1)
    elif side == "back":
        for _ in range(int(rng.integers(2, 5))):
            left, top = (int(v) for v in rng.integers(20, 180, 2))
            shade = _colour(rng.uniform(), 0.7, 0.9)
            cv2.rectangle(picture, (left, top), (left + 50, top + 34), shade, -1)
    elif side == "right":
        y = int(rng.integers(70, 180))
        cv2.rectangle(picture, (0, y), (SIZE, y + 40), livery.accent, -1)
    cv2.rectangle(picture, (0, 0), (SIZE, 26), _shaded(livery.body, 0.45), -1)
    return picture


def _shaded(colour: Colour, factor: float) -> Colour:
    red, green, blue = (min(int(value * factor), 255) for value in colour)
    return red, green, blue


PAINTERS: dict[str, Callable[[np.random.Generator, str, Livery], Picture]] = {
    "barrel": barrel,
    "bin": waste_bin,
    "cooler": cooler,
    "drum": drum,
    "engine": engine,
    "parcel": parcel,
    "speaker": speaker,
    "vendor": vendor,
}
"""Class name -> painter of a side."""
