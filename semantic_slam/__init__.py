"""Object-level semantic SLAM with a hybrid belief over poses, classes and data association.

The public Python API, imported lazily: an :class:`Engine`, built from a :class:`Configuration` and a
:class:`MapPrior`, turns each :class:`Keyframe` with its :class:`Detection` list into a :class:`HybridBelief`;
:func:`run_bag` does so for a whole bag.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

# The matrices here are small and many: OpenBLAS threads cost ten times what they gain, more beside other processes.
# OpenBLAS reads this when numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# A file of some kilobytes may claim gigabytes, in any format; OpenCV reads this when cv2 is first imported.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "100000000")

if TYPE_CHECKING:
    from semantic_slam.answers.find_objects import find_objects
    from semantic_slam.answers.get_object import get_object
    from semantic_slam.answers.query_place import query_place
    from semantic_slam.answers.question import Question
    from semantic_slam.configuration import Configuration, load_configuration
    from semantic_slam.errors import InputError, SemanticSlamError
    from semantic_slam.evaluation.belief_bag import read_record
    from semantic_slam.inference.belief import HybridBelief
    from semantic_slam.inference.engine import Engine
    from semantic_slam.inference.inputs.detection import Detection
    from semantic_slam.inference.inputs.keyframe import Keyframe
    from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
    from semantic_slam.maps.map_file import read_map, read_map_prior
    from semantic_slam.pipeline.offline import run_bag
    from semantic_slam.version import __version__

__all__ = [
    "Configuration",
    "Detection",
    "Engine",
    "HybridBelief",
    "InputError",
    "Keyframe",
    "MapPrior",
    "ObjectPrior",
    "Question",
    "SemanticSlamError",
    "__version__",
    "find_objects",
    "get_object",
    "load_configuration",
    "query_place",
    "read_map",
    "read_map_prior",
    "read_record",
    "run_bag",
]

_ORIGIN = {
    "Configuration": "configuration",
    "Detection": "inference.inputs.detection",
    "Engine": "inference.engine",
    "HybridBelief": "inference.belief",
    "InputError": "errors",
    "Keyframe": "inference.inputs.keyframe",
    "MapPrior": "inference.world.map_prior",
    "ObjectPrior": "inference.world.map_prior",
    "Question": "answers.question",
    "SemanticSlamError": "errors",
    "__version__": "version",
    "find_objects": "answers.find_objects",
    "get_object": "answers.get_object",
    "load_configuration": "configuration",
    "query_place": "answers.query_place",
    "read_map": "maps.map_file",
    "read_map_prior": "maps.map_file",
    "read_record": "evaluation.belief_bag",
    "run_bag": "pipeline.offline",
}


def __getattr__(name: str) -> Any:
    """Import public names lazily, on first access."""
    if name not in _ORIGIN:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_ORIGIN[name]}"), name)


def __dir__() -> list[str]:
    """Public names, imported or not."""
    return sorted({*globals(), *__all__})
