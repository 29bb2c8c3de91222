"""Pictures scaled into the input of a network, aspect ratio kept."""

from dataclasses import dataclass

import cv2
import numpy as np

from semantic_slam.geometry.arrays import Array, Bytes


@dataclass(frozen=True)
class Letterbox:
    """Picture scaled into the centre of a network's input: input pixel = scale * picture pixel + (left, top)."""

    pixels: Bytes  # (height, width, 3) of the input, grey outside the picture
    scale: float
    left: int
    top: int

    def to_picture(self, boxes: Array) -> Array:
        """Convert (N, 4) boxes from pixels of the input to pixels of the picture."""
        return np.asarray((boxes - np.tile([self.left, self.top], 2)) / self.scale)


def letterboxed(picture: Bytes, size: tuple[int, int], grey: int) -> Letterbox:
    """Letterbox an (H, W, 3) picture into an input of ``size`` (height, width)."""
    (height, width), (input_height, input_width) = picture.shape[:2], size
    scale = min(input_height / height, input_width / width)
    inner = (max(round(width * scale), 1), max(round(height * scale), 1))
    left, top = (input_width - inner[0]) // 2, (input_height - inner[1]) // 2
    pixels = np.full((input_height, input_width, 3), grey, dtype=np.uint8)
    pixels[top : top + inner[1], left : left + inner[0]] = cv2.resize(picture, inner, interpolation=cv2.INTER_LINEAR)
    return Letterbox(pixels, scale, left, top)
