"""A view of an object on a turntable: what networks are trained on and viewpoint models are fitted to."""

from dataclasses import dataclass

import cv2
import numpy as np

from semantic_slam.geometry.arrays import Bytes, Flags

LARGEST_CUTOUT = 128
"""Pixels; a cutout is shrunk to this, twice what the network sees."""


@dataclass(frozen=True)
class ObjectView:
    """An object cut out of its turntable picture, and from where it was seen (the camera in the object's frame)."""

    class_name: str
    azimuth_rad: float  # about the object's z from its x axis, its front
    elevation_rad: float
    range_m: float
    cutout: Bytes  # (h, w, 3) RGB, tight around the object
    mask: Bytes  # (h, w) 255 on the object, 0 beside it
    angle_deg: int = 0  # of the table, what training and test views are told apart by


def cut_out(image: Bytes, mask: Flags) -> tuple[Bytes, Bytes]:
    """Tight cutout and mask of the object that ``mask`` (H, W) marks in ``image`` (H, W, 3); the mask is not empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    cutout, alpha = image[window], mask[window].astype(np.uint8) * 255
    scale = LARGEST_CUTOUT / max(alpha.shape)
    if scale >= 1.0:
        return np.ascontiguousarray(cutout), alpha
    size = (max(round(alpha.shape[1] * scale), 1), max(round(alpha.shape[0] * scale), 1))
    shrunk = [cv2.resize(layer, size, interpolation=cv2.INTER_AREA) for layer in (cutout, alpha)]
    return np.asarray(shrunk[0], dtype=np.uint8), np.asarray(shrunk[1], dtype=np.uint8)
