"""Options ``--detector`` and ``--labels-of`` of importers of pictures, and those for what its file leaves open."""

import argparse
from pathlib import Path

from semantic_slam.errors import InputError
from semantic_slam.perception.onnx.detector import DetectorSettings, OnnxDetector, read_class_names
from semantic_slam.perception.onnx.recognition import TABLES


def add_detector(parser: argparse.ArgumentParser, otherwise: str) -> None:
    """Options of a detector; ``otherwise`` says which boxes are taken without."""
    parser.add_argument(
        "--detector", type=Path, metavar="ONNX", help=f"file of a NanoDet or YOLO network (default: {otherwise})"
    )
    parser.add_argument("--labels-of", type=Path, metavar="NAMES", help="the detector's class names, one a line")
    parser.add_argument(
        "--input-size", type=int, metavar="PIXELS", help="side of the detector's input, where its file leaves it open"
    )
    parser.add_argument(
        "--layout", choices=tuple(TABLES), help="layout of the detector's output, where its shape fits several"
    )


def detector_of(arguments: argparse.Namespace) -> OnnxDetector | None:
    """The detector of the command line, None where the folder's own boxes are wanted. Raises InputError."""
    settings = DetectorSettings(input_size=arguments.input_size, layout=arguments.layout)
    if arguments.detector is None and settings != DetectorSettings():
        raise InputError("--input-size and --layout are a detector's; give its file, too (--detector)")
    return given_detector(arguments.detector, arguments.labels_of, settings)


def given_detector(
    path: Path | None, labels_of: Path | None, settings: DetectorSettings | None = None
) -> OnnxDetector | None:
    """A detector from its two files, None where neither is given. Raises InputError."""
    if (path is None) != (labels_of is None):
        raise InputError("--detector and --labels-of go together: a network, and what its classes are called")
    return None if path is None or labels_of is None else OnnxDetector(path, read_class_names(labels_of), settings)
