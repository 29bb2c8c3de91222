"""A detector's labels as the labels of our classifier, by a YAML file of ``detector label: our label``."""

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from semantic_slam.datasets.user_bag.detector_classes import renamed
from semantic_slam.errors import InputError
from semantic_slam.perception.frame import Detections
from semantic_slam.text_files import parse_yaml, read_text

EXAMPLE = "see config/labels_example.yaml"


@dataclass
class LabelMap:
    """Applies a mapping and counts what it drops; without a mapping every label is kept as it is."""

    mapping: dict[str, str | None] | None = None  # detector label -> our label, None: dropped
    unwanted: Counter[str] = field(default_factory=Counter)  # dropped because the file maps them to null
    unknown: Counter[str] = field(default_factory=Counter)  # dropped because the file does not list them

    def apply(self, detections: Detections) -> tuple[Detections, list[int]]:
        """The detections whose labels are wanted, renamed, and which rows these were."""
        if self.mapping is None:
            return detections, list(range(len(detections)))
        kept = [index for index, label in enumerate(detections.labels) if self._wanted(label)]
        labels = tuple(str(self.mapping[detections.labels[index]]) for index in kept)
        taken = renamed(detections.take(np.array(kept, dtype=np.intp)), self.mapping)
        return replace(taken, labels=labels), kept

    def _wanted(self, label: str) -> bool:
        assert self.mapping is not None
        if label not in self.mapping:
            self.unknown[label] += 1
            return False
        if self.mapping[label] is None:
            self.unwanted[label] += 1
            return False
        return True


def read_label_map(path: Path) -> LabelMap:
    """Label map from a YAML file; raises InputError that names the entry at fault."""
    values = parse_yaml(read_text(path, EXAMPLE), str(path), EXAMPLE)
    if not isinstance(values, dict) or not values:
        raise InputError(f"{path}: a mapping 'detector label: our label' is expected; {EXAMPLE}")
    return LabelMap(
        {_label(key, path): None if value is None else _label(value, path) for key, value in values.items()}
    )


def _label(value: object, path: Path) -> str:
    """YAML reads unquoted ``on``, ``no`` or ``3.0`` as something else than text; whole numbers are class numbers."""
    if isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool)):
        return str(value)
    raise InputError(f"{path}: {value!r} is not a label; put it in quotes ({EXAMPLE})")
