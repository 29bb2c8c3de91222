"""The study of embeddings: what is drawn is found and its probabilities are honest; photographs where there are any."""

import os
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.studies.embeddings import texts
from semantic_slam_lab.studies.embeddings.drives import driven
from semantic_slam_lab.studies.embeddings.gallery import drawn, photographed
from semantic_slam_lab.studies.embeddings.questions import asked_of_map, scores

pytestmark = pytest.mark.slow


def some_of(data: Path, folder: Path) -> Path:
    """A folder of links to photographs of a few objects, and to the networks."""
    (folder / "coil100").mkdir()
    (folder / "weights").symlink_to(data / "weights")
    for picture in sorted((data / "coil100").glob("obj*__*0.*")):
        if int(picture.stem.partition("__")[0].removeprefix("obj")) % 6 == 0:
            (folder / "coil100" / picture.name).symlink_to(picture)
    return folder


@pytest.mark.long
def test_drawn_things_are_found_by_views_that_the_map_has_not_seen():
    found = scores(asked_of_map(drawn(0), "around", 0), "ours")
    assert found["right"] > 0.95 and found["ece"] < 0.05


def test_texts_that_point_weakly_are_not_answered_surely():
    found = texts.scores(texts.named_on_map(drawn(0), "weak", 0))
    assert found["right_not_mapped"] == 1.0


def test_a_room_is_associated_and_asked():
    metrics, asked = driven(drawn(0), 0, 10)
    assert metrics["embedding"]["association_f1"] > 0.8 and asked
    assert np.allclose([own.ours.sum() for own in asked], 1.0)


@pytest.mark.long
@pytest.mark.real_data
def test_photographs_are_found_by_other_views_of_them(tmp_path: Path) -> None:
    """Of some objects, every ten degrees."""
    gallery = photographed(some_of(Path(os.environ["SEMANTIC_SLAM_DATA"]), tmp_path), "squeezenet")
    found = scores(asked_of_map(gallery, "around", 0), "ours")
    assert found["right"] >= 0.95 and found["ece"] <= 0.05
