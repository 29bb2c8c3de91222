"""Encoded pictures of a few bytes that claim gigabytes."""

import struct
import zlib

import cv2
import numpy as np


def png_that_claims(width: int, height: int) -> bytes:
    """69 bytes and less: one black pixel, and the size of another picture."""
    png = cv2.imencode(".png", np.zeros((1, 1, 3), np.uint8))[1].tobytes()
    header = b"IHDR" + struct.pack(">II", width, height) + png[24:29]
    return png[:12] + header + struct.pack(">I", zlib.crc32(header)) + png[33:]


def png_with_a_chunk_of(length: int) -> bytes:
    """A png of 32 x 24 whose second chunk says that it has ``length`` bytes."""
    png = cv2.imencode(".png", np.zeros((24, 32, 3), np.uint8))[1].tobytes()
    return png[:33] + struct.pack(">I", length) + png[37:]
