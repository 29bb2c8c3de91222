"""Pictures as nobody should send them: damaged, or with sizes, encodings and cameras that are not theirs."""

import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.random import Generator

from semantic_slam.messages.images import decode_depth, decode_image
from semantic_slam.messages.standard import header_message
from semantic_slam.messages.typestore import message_class
from semantic_slam_lab.fuzz.harness import Case
from semantic_slam_lab.fuzz.mutation import EXTREME_NUMBERS, damaged

HEIGHT, WIDTH = 24, 32


def pictures(folder: Path) -> Case:
    """Pictures of every encoding, damaged, or with sizes that are not theirs."""
    chance = np.random.default_rng(0)
    colour = chance.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    depth = chance.integers(0, 9000, (HEIGHT, WIDTH), dtype=np.uint16)
    jpeg, png, deep = (
        cv2.imencode(*made)[1].tobytes() for made in ((".jpg", colour), (".png", colour), (".png", depth))
    )
    metres = (depth / 1000.0).astype(np.float32).tobytes()

    def case(chance: Generator) -> None:
        readers: list[tuple[Any, Any]] = [
            (decode_image, _compressed("jpeg", damaged(jpeg, chance))),
            (decode_image, _compressed("png", damaged(png, chance))),
            (decode_image, _compressed("png", _with_size(png, chance))),
            (decode_depth, _compressed("16UC1; compressedDepth png", bytes(12) + damaged(deep, chance))),
            (decode_depth, _compressed("32FC1; compressedDepth png", damaged(bytes(12) + deep, chance))),
            (decode_depth, _compressed("16UC1; png", _with_size(deep, chance))),
            (decode_image, _raw("rgb8", colour.tobytes(), chance)),
            (decode_depth, _raw("32FC1", metres, chance)),
            (decode_depth, _disparities(metres, chance)),
        ]
        read, message = readers[chance.integers(len(readers))]
        read(message, "image")

    return case


def _compressed(text: str, data: bytes) -> Any:
    kind = message_class("sensor_msgs/msg/CompressedImage")
    return kind(header=header_message(0, "camera"), format=text, data=np.frombuffer(data, np.uint8))


def _with_size(png: bytes, chance: Generator) -> bytes:
    """A png that claims another size, with the checksum of that."""
    sizes = (0, 1, 25, 40_000, 60_000, 2**31 - 1)
    width, height = (sizes[n] for n in chance.integers(len(sizes), size=2))
    header = b"IHDR" + struct.pack(">II", width, height) + png[24:29]
    return png[:12] + header + struct.pack(">I", zlib.crc32(header)) + png[33:]


def _raw(encoding: str, data: bytes, chance: Generator) -> Any:
    numbers = (0, 1, 24, 32, 64, 96, 128, 2**31, 2**32 - 1)
    height, width, step = (int(numbers[n]) for n in chance.integers(len(numbers), size=3))
    return message_class("sensor_msgs/msg/Image")(
        header=header_message(0, "camera"),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=step,
        data=np.frombuffer(data, np.uint8),
    )


def _disparities(data: bytes, chance: Generator) -> Any:
    """A DisparityImage, now and then with a pair of cameras and a window that cannot be."""
    pair = np.where(chance.random(4) < 0.3, chance.choice(EXTREME_NUMBERS, 4), (500.0, 0.12, 0.5, 64.0))
    window = message_class("sensor_msgs/msg/RegionOfInterest")(
        **{name: int(chance.choice((0, 1, 24, 2**32 - 1))) for name in ("x_offset", "y_offset", "height", "width")},
        do_rectify=False,
    )
    limits = dict(zip(("f", "t", "min_disparity", "max_disparity"), pair.tolist(), strict=True))
    image = _raw("32FC1", data if chance.random() < 0.5 else damaged(data, chance), chance)
    if chance.random() < 0.5:
        image.height, image.width, image.step = HEIGHT, WIDTH, 4 * WIDTH
    return message_class("stereo_msgs/msg/DisparityImage")(
        header=image.header, image=image, valid_window=window, delta_d=0.0625, **limits
    )
