"""Pictures of things that nobody knows, made up: what known objects are told from by how they look.

Outlines without corners, textures whose spectra fall as those of photographs do, patches, stripes and shading: drawn at
random, and shown in the same random rooms as the known objects are; now and then a box has nothing in it but the room.
No photograph lies in it.
"""

import cv2
import numpy as np

from semantic_slam.geometry.arrays import Array, Bytes, Flags
from semantic_slam.training.augmentation import room_crop
from semantic_slam.training.views import LARGEST_CUTOUT, ObjectView

SLOPES = (0.8, 2.2)
"""How steeply spectra of textures fall; those of photographs do about as 1 / f."""
WAVES = 6
"""Harmonics of an outline."""
EMPTY_SHARE = 0.2
"""Share of the boxes with nothing in them, as a detector's false alarms are."""


def other_crop(size: int, generator: np.random.Generator) -> Bytes:
    """(size, size, 3) crop of a thing that is made up, in a random room, or of the room alone."""
    if generator.random() < EMPTY_SHARE:
        cutout = np.zeros((LARGEST_CUTOUT, LARGEST_CUTOUT, 3), dtype=np.uint8)
        return room_crop(ObjectView("", 0.0, 0.0, 1.0, cutout, cutout[..., 0]), size, generator)
    texture, outline = _texture(generator), _outline(generator)
    shape = np.round(LARGEST_CUTOUT * np.exp(generator.normal(0.0, 0.25, 2))).astype(int)
    cutout = cv2.resize(texture, tuple(shape.tolist()))
    mask = cv2.resize(outline.astype(np.uint8) * np.uint8(255), tuple(shape.tolist()))
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return room_crop(ObjectView("", 0.0, 0.0, 1.0, cutout[window], mask[window]), size, generator)


def _texture(generator: np.random.Generator) -> Bytes:
    """(n, n, 3) colours."""
    light = _cloud(generator, generator.uniform(*SLOPES))[..., None] * generator.uniform(5.0, 60.0)
    tints = np.stack([_cloud(generator, generator.uniform(*SLOPES)) for _ in range(2)], axis=-1)
    colours = generator.uniform(40.0, 215.0, 3) + light
    colours = colours + tints @ generator.standard_normal((2, 3)) * generator.uniform(0.0, 40.0)
    for _ in range(generator.integers(0, 4)):
        patch = _cloud(generator, SLOPES[1]) > generator.uniform(-0.5, 1.5)
        colours[patch] = 0.4 * colours[patch] + 0.6 * generator.uniform(0.0, 255.0, 3)
    if generator.random() < 0.3:
        pitch = generator.uniform(0.1, 1.2) * LARGEST_CUTOUT / 2.0
        colours = colours + np.sin(pitch * _ramp(generator))[..., None] * generator.uniform(10.0, 60.0)
    shade = 1.0 + generator.uniform(0.0, 0.5) * _ramp(generator)
    return np.asarray(np.clip(colours * shade[..., None], 0.0, 255.0), dtype=np.uint8)


def _cloud(generator: np.random.Generator, slope: float) -> Array:
    """(n, n) noise of mean 0 and variance 1 whose amplitudes fall as frequency to the power of -``slope``."""
    frequency = np.fft.fftfreq(LARGEST_CUTOUT)
    radius = np.hypot(frequency[:, None], frequency)
    radius[0, 0] = 1.0
    white = generator.standard_normal((2, LARGEST_CUTOUT, LARGEST_CUTOUT))
    values = np.fft.ifft2((white[0] + 1j * white[1]) * radius**-slope).real
    return np.asarray((values - values.mean()) / values.std())


def _ramp(generator: np.random.Generator) -> Array:
    """(n, n) rising from about -1 to 1 in a random direction."""
    turn, along = generator.uniform(0.0, 2.0 * np.pi), np.linspace(-1.0, 1.0, LARGEST_CUTOUT)
    return np.asarray(along * np.cos(turn) + along[:, None] * np.sin(turn))


def _outline(generator: np.random.Generator) -> Flags:
    """(n, n) inside of a smooth closed curve about the middle."""
    along = np.linspace(-1.0, 1.0, LARGEST_CUTOUT)
    waves = np.arange(1, WAVES + 1)
    heights = generator.standard_normal(WAVES) / waves**1.3 * generator.uniform(0.0, 0.25)
    angle = np.arctan2(along[:, None], along)[..., None] * waves + generator.uniform(0.0, 2.0 * np.pi, WAVES)
    return np.asarray(np.hypot(along[:, None], along) < 0.8 * np.exp((heights * np.cos(angle)).sum(axis=-1)))
