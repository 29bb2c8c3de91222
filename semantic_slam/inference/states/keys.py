"""The GTSAM keys of poses, objects, descriptors, biases of odometry and errors of detections."""

import string
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import gtsam
import numpy as np


@cache
def robot_key(keyframe: int) -> int:
    """X(k + 1) for keyframe k; X(0) is the prior pose."""
    return int(gtsam.symbol("x", keyframe + 1))


@cache
def object_key(object_id: int) -> int:
    """GTSAM key O(n) of an object."""
    return int(gtsam.symbol("o", object_id))


@cache
def descriptor_key(object_id: int) -> int:
    """GTSAM key E(n) of an object's descriptor."""
    return int(gtsam.symbol(DESCRIPTOR, object_id))


DESCRIPTOR = "e"
"""Symbol of E(n), below those of objects and robots."""
_SYMBOL_BITS = 56
"""Number of bits of a GTSAM key's index, below its letter."""
_DESCRIPTOR_CODE, _ROBOT_CODE, _OBJECT_CODE = ord(DESCRIPTOR), ord("x"), ord("o")


def letter_of(key: int) -> str:
    """The letter of a GTSAM key."""
    return chr(key >> _SYMBOL_BITS)


def number_of(key: int) -> int:
    """The index of a GTSAM key: for a robot pose its keyframe + 1, for an object its id."""
    return key & ((1 << _SYMBOL_BITS) - 1)


def is_robot(key: int) -> bool:
    """Whether a GTSAM key is some X(k)."""
    return key >> _SYMBOL_BITS == _ROBOT_CODE


def is_object(key: int) -> bool:
    """Whether a GTSAM key is some O(n)."""
    return key >> _SYMBOL_BITS == _OBJECT_CODE


def is_descriptor(key: int) -> bool:
    """Whether a GTSAM key is some E(n)."""
    return key >> _SYMBOL_BITS == _DESCRIPTOR_CODE


BIAS_LETTER = "c"
STRETCH = 100
"""Number of keyframes that share one bias variable."""


@cache
def bias_key(keyframe: int) -> int:
    """GTSAM key of the odometry bias of the motion to a keyframe, -1 being the start."""
    return int(gtsam.symbol(BIAS_LETTER, max(keyframe, 0) // STRETCH))


def is_bias(key: int) -> bool:
    """Whether a GTSAM key is a bias of odometry."""
    return letter_of(key) == BIAS_LETTER


def begins_stretch(keyframe: int) -> bool:
    """Whether the motion to this keyframe has a new bias variable."""
    return keyframe > 0 and keyframe % STRETCH == 0


ERROR_LETTERS = string.ascii_uppercase
"""Letters of variables that hold the correlated errors of one detection, of two, and so on; sorted below all others."""
MOST_TOGETHER = len(ERROR_LETTERS)
"""Largest number of detections whose errors one variable holds; a frame with more has several variables."""
_MOST_VARIABLES = 1 << 12
"""Largest number of such variables per frame."""
VECTOR_SIZES = {BIAS_LETTER: 4} | {letter: 2 * count for count, letter in enumerate(ERROR_LETTERS, start=1)}
"""Dimension of vector variables by letter: of an odometry bias, and of the errors of some detections."""


class ErrorPlace(NamedTuple):
    """Location of a detection's error within a variable of the smoother."""

    key: int
    first: int  # index of the first of its two components
    size: int  # dimension of the variable


def error_keys(keyframe: int, count: int) -> list[int]:
    """Keys of the variables that hold the correlated errors of a keyframe's ``count`` detections, in order."""
    sizes = [min(MOST_TOGETHER, count - first) for first in range(0, count, MOST_TOGETHER)]
    return [
        int(gtsam.symbol(ERROR_LETTERS[size - 1], keyframe * _MOST_VARIABLES + place))
        for place, size in enumerate(sizes)
    ]


def error_place(keyframe: int, count: int, number: int) -> ErrorPlace:
    """Location of the error of detection ``number`` of the ``count`` detections of a keyframe."""
    key = error_keys(keyframe, count)[number // MOST_TOGETHER]
    return ErrorPlace(key, 2 * (number % MOST_TOGETHER), VECTOR_SIZES[letter_of(key)])


def detection_of(key: int, first: int) -> int:
    """Number of the detection whose error begins at ``first`` in the variable of a ``key``, as :func:`error_place`."""
    return (number_of(key) % _MOST_VARIABLES) * MOST_TOGETHER + first // 2


def vector_parts(keys: Sequence[int]) -> list[slice]:
    """Slices of the components of each vector variable in their concatenation."""
    ends = np.cumsum([VECTOR_SIZES[letter_of(key)] for key in keys]).tolist()
    return [slice(end - VECTOR_SIZES[letter_of(key)], end) for key, end in zip(keys, ends, strict=True)]


def is_vector(key: int) -> bool:
    """Whether a GTSAM key is a bias of odometry or the errors of detections."""
    return letter_of(key) in VECTOR_SIZES
