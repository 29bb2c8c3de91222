"""Segments with vectors, as semantic_inference tells them, are detections with embeddings."""

from pathlib import Path

import numpy as np
import pytest
from worlds.bags.imported import import_bag
from worlds.bags.user_bag_factory import FOCAL, Seen, UserBag, write_drive

from semantic_slam.datasets.user_bag.feature_images import from_feature_image
from semantic_slam.errors import MessageError


def test_a_bag_of_segments_is_imported_with_their_vectors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = write_drive(tmp_path / "source", detector="segments")
    first = import_bag(monkeypatch, "bag", source, "--out", tmp_path / "bag")["/detections"][0]
    u = round(80 + FOCAL * 0.5 / 3.0)
    assert first.labels == ("", "") and first.frame_id == "camera_optical_frame"
    np.testing.assert_array_equal(first.boxes[0], [u - 12, 48, u + 12, 72])
    np.testing.assert_array_equal(first.embeddings, [[1, 1, 0], [2, 1, 0]])


@pytest.mark.parametrize(("encoding", "numbered"), [("16UC1", True), ("32SC1", True), ("16UC1", False)])
def test_what_others_hide_is_left_out(tmp_path: Path, encoding: str, numbered: bool) -> None:
    behind, small = Seen("", 40.0, size=10.0), Seen("", 120.0, size=6.0)
    told = UserBag(tmp_path / "bag", "segments").segments(7, [behind, Seen("", 40.0), small], encoding, numbered)
    found = from_feature_image(told)
    np.testing.assert_array_equal(found.boxes, [[28, 48, 52, 72], [117, 57, 123, 63]])
    np.testing.assert_array_equal(found.embeddings[:, 0], [2, 3])
    assert found.stamp_ns == 7


def test_a_picture_without_segments_and_wrong_messages(tmp_path: Path) -> None:
    bag = UserBag(tmp_path / "bag", "segments")
    assert len(from_feature_image(bag.segments(0, []))) == 0
    wrong = bag.segments(0, [Seen("", 40.0), Seen("", 90.0)])
    wrong.mask_ids = wrong.mask_ids[:1]
    with pytest.raises(MessageError, match="1 masks and 2 features"):
        from_feature_image(wrong)
    coloured = bag.segments(0, [Seen("", 40.0)])
    coloured.image.encoding = "rgb8"
    with pytest.raises(MessageError, match="encoding 'rgb8' is not read"):
        from_feature_image(coloured)
