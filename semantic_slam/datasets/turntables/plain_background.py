"""Where the object is in a picture before a plain background, whose colour the picture's border tells."""

import cv2
import numpy as np

from semantic_slam.geometry.arrays import Array, Bytes, Flags

LEAST_DIFFERENCE = 18.0
"""Grey levels that a pixel differs from the background's colour, in any channel, to be of the object."""
NOISE_FACTOR = 1.5
"""Multiple of the border's own spread (its 90th percentile) that counts where it is wider."""
LEAST_SHARE = 0.05
"""Share of the largest piece's area; smaller ones are specks of the background."""


def object_mask(image: Bytes) -> Flags:
    """(H, W) where (H, W, 3) differs from the median colour of its border, holes filled; may be empty."""
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]]).astype(np.float64)
    background = np.median(border, axis=0)
    noise = float(np.percentile(_difference(border, background), 90.0))
    differs = _difference(image, background) > max(LEAST_DIFFERENCE, NOISE_FACTOR * noise)
    mask = cv2.morphologyEx(differs.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    outlines = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    areas = [cv2.contourArea(outline) for outline in outlines]
    pieces = [own for own, area in zip(outlines, areas, strict=True) if area >= LEAST_SHARE * max(areas)]
    return np.asarray(cv2.drawContours(np.zeros_like(mask), pieces, -1, 1, cv2.FILLED) > 0)


def _difference(pixels: Array | Bytes, colour: Array) -> Array:
    """(...,) largest difference of (..., 3) pixels from a colour in any channel."""
    return np.asarray(np.abs(pixels.astype(np.float64) - colour).max(axis=-1))
