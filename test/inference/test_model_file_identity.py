"""A run is one with the file of class models that it was announced with: not with another one of that name."""

from pathlib import Path

import numpy as np
import pytest

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.building import (
    initial_pose_of,
    make_run_configuration,
    problem_of,
)
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.run_id import is_id_of_its_contents
from semantic_slam.viewpoint.labels.confusion import Confusion
from semantic_slam.viewpoint.labels.settings import LabelSettings
from semantic_slam.viewpoint.labels.store import FittedLabels, save_labels

LABELS = ("cup", "tv")


def write_models(path: Path, accuracy: float) -> None:
    fitted = FittedLabels(
        labels=LABELS,
        settings=LabelSettings.grid((0.0,), (0.5,), (1.0,)),
        confusions=(Confusion.symmetric(len(LABELS), accuracy, 4.0, 0.05),),
        class_shares=np.full(3, 1.0 / 3.0),
        bags=(),
        report={},
    )
    save_labels(fitted, path)


def announced(path: Path, digest: str = "") -> RunConfiguration:
    settings = {"kind": "detector", "labels": list(LABELS), "path": str(path), "path_digest": digest}
    own = Configuration.of(association="given", semantic_model=settings)
    return make_run_configuration(own, None, *initial_pose_of(own), stamp_ns=0)


def test_a_run_with_another_file_of_that_name_is_another_run(tmp_path: Path) -> None:
    path = tmp_path / "models.safetensors"
    write_models(path, 0.75)
    first = announced(path)
    assert announced(path).run_id == first.run_id and is_id_of_its_contents(first)
    problem_of(first)
    write_models(path, 0.8)
    assert announced(path).run_id != first.run_id
    with pytest.raises(InputError, match=r"models\.safetensors: is not the file that the run was announced with"):
        problem_of(first)


def test_a_configuration_may_ask_for_one_file(tmp_path: Path) -> None:
    path = tmp_path / "models.safetensors"
    write_models(path, 0.75)
    with pytest.raises(InputError, match=r"leave out semantic_model\.path_digest"):
        announced(path, "0123")
