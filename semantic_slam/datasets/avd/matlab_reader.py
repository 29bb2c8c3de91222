"""Prints the variables of a MATLAB file as JSON: a process of its own, since scipy's reader may end in a segfault.

Usage: python -m semantic_slam.datasets.avd.matlab_reader FILE. Exit code 1, with the reason on stderr, if scipy cannot
read it. Structs become objects, arrays nested lists.
"""

import json
import resource
import sys
from typing import Any

import numpy as np
from scipy.io import loadmat

MOST_MEMORY_BYTES, MOST_CPU_S = 4 << 30, 120
"""Limits of the process: a damaged file may claim any size."""


def plain(value: Any) -> Any:
    """What JSON can express of a value as scipy returns it."""
    if isinstance(value, np.ndarray) and value.dtype.names is None:
        return [plain(item) for item in value.tolist()] if value.dtype == object else value.tolist()
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.void) and value.dtype.names is not None:
        return {name: plain(value[name]) for name in value.dtype.names}
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value if isinstance(value, str | int | float | bool) else None


def main(path: str) -> int:
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY_BYTES, MOST_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S))
    try:
        text = json.dumps({name: plain(value) for name, value in loadmat(path).items()})
    except Exception as fault:  # of damaged files scipy's reader raises whatever comes, UnboundLocalError among it
        print(" ".join(str(fault).split()) or type(fault).__name__, file=sys.stderr)
        return 1
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
