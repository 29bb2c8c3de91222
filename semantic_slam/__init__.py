"""Object-level semantic SLAM with a hybrid belief over poses, classes and data association."""

import os
from typing import Any

# Matrices here are small and many: OpenBLAS's threads cost ten times what they gain, and more beside other processes.
# It reads this when numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def __getattr__(name: str) -> Any:
    """Names that cost an import only where they are asked for."""
    if name == "__version__":
        from semantic_slam.version import __version__

        return __version__
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
