"""Options ``--detector`` and ``--labels-of`` of importers of pictures."""

import argparse
from pathlib import Path

from semantic_slam.errors import InputError
from semantic_slam.perception.onnx_detector import OnnxDetector, read_class_names


def add_detector(parser: argparse.ArgumentParser, otherwise: str) -> None:
    """Both options; ``otherwise`` says which boxes are taken without."""
    parser.add_argument("--detector", type=Path, metavar="ONNX", help=f"NanoDet file (default: {otherwise})")
    parser.add_argument("--labels-of", type=Path, metavar="NAMES", help="the detector's class names, one a line")


def given_detector(path: Path | None, labels_of: Path | None) -> OnnxDetector | None:
    """The detector of the command line, None where the folder's own boxes are wanted. Raises InputError."""
    if (path is None) != (labels_of is None):
        raise InputError("--detector and --labels-of go together: a network, and what its classes are called")
    return None if path is None or labels_of is None else OnnxDetector(path, read_class_names(labels_of))
