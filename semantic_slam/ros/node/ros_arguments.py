"""ROS arguments of a command line, with errors of one line in place of rcl's."""

import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from rclpy.utilities import remove_ros_args

from semantic_slam.errors import InputError, one_line

PLACE_IN_RCL = re.compile(r" ?, at /\S+?\.c:\d+")
"""What rcl adds to its errors: where in its sources they arose."""

REMEDIES = {
    "should be of same type": "write all numbers of a list with a point, as 1.0, and names in quotes",
    "No value": "give a value there, or remove that line",
    "before ros__parameters": "begin with '/**:' and 'ros__parameters:', as config/default.yaml does",
    "support aliasing": "write the values out",
}
"""Remedies by words of rcl's errors."""


def without_ros_arguments(words: Sequence[str]) -> list[str]:
    """The other words of a command line, its name first; raises InputError for invalid ROS arguments.

    To be called before rclpy starts, which would write the same fault to the console in its own words.
    """
    return list(parsed(lambda: remove_ros_args(list(words)), words))


def parsed(parse: Callable[[], Any], words: Sequence[str]) -> Any:
    """Result of a function that parses the ROS arguments among ``words``; raises InputError for invalid ones."""
    try:
        return parse()
    except RuntimeError as fault:  # command line or parameter file
        for name, file in pairwise(words):
            if name == "--params-file" and not Path(file).exists():
                raise InputError(f"{file}: no such file of parameters; give a copy of config/default.yaml") from None
        what = PLACE_IN_RCL.sub("", one_line(fault, 300))
        remedy = next((own for words, own in REMEDIES.items() if words in what), "see config/default.yaml")
        raise InputError(f"{what}; {remedy}") from None
