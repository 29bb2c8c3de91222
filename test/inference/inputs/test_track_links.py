"""What tracks tell of which object a box is."""

import numpy as np

from semantic_slam.inference.semantics.detector.track_links import TrackLinks

LINKS = TrackLinks(0.02)
RIGHT, WRONG = np.log(0.98), np.log(0.02)


def test_a_box_goes_on_with_the_object_of_its_track_and_with_no_other() -> None:
    np.testing.assert_allclose(LINKS.log_pairs(["7"], ["5", "7"]), [[WRONG, RIGHT, WRONG]])


def test_an_object_whose_track_goes_on_in_one_box_is_not_another_box_of_the_frame() -> None:
    told = LINKS.log_pairs(["7", "9"], ["7", "4"])
    np.testing.assert_allclose(told, [[RIGHT, WRONG, WRONG], [WRONG, 0.0, 0.0]])


def test_tracks_that_nobody_had_and_boxes_without_one_tell_nothing() -> None:
    assert not LINKS.log_pairs(["8", ""], ["5", ""]).any()
    assert LINKS.log_pairs([], ["5"]).shape == (0, 2)
