"""The GTSAM keys of poses, objects, descriptors and biases."""

from functools import cache

import gtsam


def robot_key(keyframe: int) -> int:
    """X(k + 1) for keyframe k; X(0) is the prior pose."""
    return int(gtsam.symbol("x", keyframe + 1))


@cache
def object_key(object_id: int) -> int:
    """O(n)."""
    return int(gtsam.symbol("o", object_id))


@cache
def descriptor_key(object_id: int) -> int:
    """E(n)."""
    return int(gtsam.symbol(DESCRIPTOR, object_id))


DESCRIPTOR = "e"
"""Symbol of E(n), below those of objects and robots."""
_SYMBOL_BITS = 56
"""Of a key, before its letter."""
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
