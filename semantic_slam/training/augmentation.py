"""Augmentation of turntable views to room images: background, lighting, blur and inexact boxes."""

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.crops import square_crop
from semantic_slam.training.views import ObjectView

Floats = NDArray[np.float32]

SMALLEST_OBJECT = 30
"""Pixels of an object's longer side at the far end of a room."""
LARGEST_OBJECT = 100
BOX_JITTER = 0.06
"""Standard deviation of each box edge, as a fraction of the object's size."""
HIDDEN_PROBABILITY = 0.25
"""Probability that a part of the object is hidden, as by what stands before it or by the image's border."""
LARGEST_HIDDEN_SHARE = 0.35


def room_crop(view: ObjectView, size: int, generator: np.random.Generator) -> Bytes:
    """(size, size, 3) crop of the object in a random room, as ``square_crop`` would deliver it."""
    cutout, alpha = _at_random_scale(view, generator)
    height, width = alpha.shape
    side = int(1.6 * max(height, width)) + 4
    canvas = _background(side, side, generator)
    left, top = (side - width) // 2, (side - height) // 2
    window = canvas[top : top + height, left : left + width]
    window += alpha[..., None] * (_lit(cutout, generator) - window)
    box = np.array([left, top, left + width, top + height], dtype=np.float64)
    if generator.random() < HIDDEN_PROBABILITY:
        canvas, box = _hide_a_side(canvas, box, generator)
    box += generator.normal(0.0, BOX_JITTER, 4) * np.array([width, height, width, height])
    return square_crop(_camera(canvas, generator), box, size)


def _at_random_scale(view: ObjectView, generator: np.random.Generator) -> tuple[Floats, Floats]:
    """Cutout and opacity (0..1) at a random size between far away and near."""
    height, width = view.mask.shape
    longest = np.exp(generator.uniform(np.log(SMALLEST_OBJECT), np.log(LARGEST_OBJECT)))
    scale = longest / max(height, width)
    squeeze = np.exp(generator.normal(0.0, 0.04))
    size = (max(round(width * scale * squeeze), 2), max(round(height * scale / squeeze), 2))
    method = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    cutout = cv2.resize(view.cutout, size, interpolation=method).astype(np.float32)
    return cutout, cv2.resize(view.mask, size, interpolation=method).astype(np.float32) / np.float32(255.0)


def _background(height: int, width: int, generator: np.random.Generator) -> Floats:
    """Wall above floor, each a soft gradient, now and then with a piece of furniture."""
    canvas = np.empty((height, width, 3), dtype=np.float32)
    horizon = int(np.clip(generator.normal(0.45, 0.25), 0.0, 1.0) * height)
    canvas[:horizon] = _gradient(horizon, width, generator)
    canvas[horizon:] = _gradient(height - horizon, width, generator)
    for _ in range(generator.integers(0, 3)):
        low = generator.uniform(-0.2, 0.9, 2) * (width, height)
        high = low + generator.uniform(0.1, 0.6, 2) * (width, height)
        x, y = np.clip(np.array([low, high]).T, 0, [[width], [height]]).astype(int)
        canvas[y[0] : y[1], x[0] : x[1]] = _colour(generator)
    canvas += generator.standard_normal((height, width, 1), dtype=np.float32) * np.float32(generator.uniform(0.0, 8.0))
    return canvas


def _gradient(height: int, width: int, generator: np.random.Generator) -> Floats:
    corners = _colour(generator) * generator.uniform(0.75, 1.25, (2, 2, 1))
    return np.asarray(cv2.resize(corners.astype(np.float32), (width, max(height, 1)))[:height], dtype=np.float32)


def _colour(generator: np.random.Generator) -> Array:
    """(3,) grey to beige mostly, any colour at times."""
    if generator.random() < 0.25:
        return generator.uniform(20.0, 240.0, 3)
    return generator.uniform(40.0, 230.0) * np.array([1.0, generator.uniform(0.85, 1.02), generator.uniform(0.7, 1.05)])


def _lit(cutout: Floats, generator: np.random.Generator) -> Floats:
    """The object under another light: a ramp of brightness, a tint, at times the edge of a shadow."""
    height, width = cutout.shape[:2]
    ramp = cv2.resize(np.exp(generator.normal(0.0, 0.25, (2, 2))).astype(np.float32), (width, height))
    light = np.float32(generator.uniform(0.65, 1.3)) * np.asarray(ramp, dtype=np.float32)
    if generator.random() < 0.2:
        angle = generator.uniform(0.0, 2.0 * np.pi)
        x, y = np.linspace(-1.0, 1.0, width) * np.cos(angle), np.linspace(-1.0, 1.0, height) * np.sin(angle)
        beyond = x + y[:, None] > generator.uniform(-0.8, 0.8)
        light = np.where(beyond, light * np.float32(generator.uniform(0.4, 0.9)), light)
    tint = np.exp(generator.normal(0.0, 0.04, 3)).astype(np.float32)
    return np.asarray(cutout * light[..., None] * tint, dtype=np.float32)


def _hide_a_side(canvas: Floats, box: Array, generator: np.random.Generator) -> tuple[Floats, Array]:
    """Part of the object behind something or beyond the image's border; the box then ends there, or is not told."""
    axis, at_end = generator.integers(2), bool(generator.integers(2))
    share = generator.uniform(0.05, LARGEST_HIDDEN_SHARE) * (box[axis + 2] - box[axis])
    edge = round(box[axis + 2] - share if at_end else box[axis] + share)
    hidden = slice(edge, None) if at_end else slice(0, edge)
    visible_box = box.copy()
    visible_box[axis + 2 if at_end else axis] = edge
    if generator.random() < 0.5:
        canvas[(slice(None), hidden) if axis == 0 else (hidden, slice(None))] = _colour(generator)
        return canvas, visible_box if generator.random() < 0.5 else box
    seen = slice(0, edge) if at_end else slice(edge, None)
    if not at_end:
        visible_box[[axis, axis + 2]] -= edge
    return canvas[(slice(None), seen) if axis == 0 else (seen, slice(None))], visible_box


def _camera(canvas: Floats, generator: np.random.Generator) -> Bytes:
    """Blur, contrast, sensor noise and 8 bits."""
    if generator.random() < 0.5:
        canvas = np.asarray(cv2.GaussianBlur(canvas, (0, 0), generator.uniform(0.3, 1.0)), dtype=np.float32)
    contrast, brightness = np.float32(generator.uniform(0.8, 1.2)), np.float32(generator.uniform(-20.0, 20.0))
    noise = generator.standard_normal(canvas.shape, dtype=np.float32) * np.float32(generator.uniform(0.0, 6.0))
    return np.clip((canvas - 128) * contrast + (128 + brightness) + noise, 0, 255).astype(np.uint8)
