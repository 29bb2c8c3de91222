"""The GTSAM keys of poses, objects, descriptors, biases of odometry and errors of detections."""

from functools import cache

import gtsam


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
"""Number of bits of a GTSAM key below its letter."""
_DESCRIPTOR_CODE, _ROBOT_CODE, _OBJECT_CODE = ord(DESCRIPTOR), ord("x"), ord("o")


def letter_of(key: int) -> str:
    """The letter of a GTSAM key."""
    return chr(key >> _SYMBOL_BITS)


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
"""Keyframes with one bias."""


def bias_key(keyframe: int) -> int:
    """The bias of the motion to a keyframe, -1 being the start."""
    return int(gtsam.symbol(BIAS_LETTER, max(keyframe, 0) // STRETCH))


def begins_stretch(keyframe: int) -> bool:
    """Whether the bias of the motion to this keyframe is a new one."""
    return keyframe > 0 and keyframe % STRETCH == 0


ERROR_LETTER = "d"
VECTOR_SIZES = {BIAS_LETTER: 4, ERROR_LETTER: 2}
"""Components of a bias of odometry, and of an error of a detection."""
_MOST_DETECTIONS = 1 << 16
"""In one frame."""


def error_key(keyframe: int, number: int) -> int:
    """Error that repeats, of one detection of a keyframe."""
    return int(gtsam.symbol(ERROR_LETTER, keyframe * _MOST_DETECTIONS + number))


def error_keys(keyframe: int, count: int) -> list[int]:
    """Errors that repeat, of the ``count`` detections of a keyframe."""
    return [error_key(keyframe, number) for number in range(count)]


def is_vector(key: int) -> bool:
    """Whether a GTSAM key is a bias of odometry or an error of a detection."""
    return letter_of(key) in VECTOR_SIZES
