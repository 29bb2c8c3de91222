"""True identities in a user's bag stay with their detections where a label file drops some."""

import pytest
from worlds.bags.imported import import_bag, merge_bags, read_bag, run_import
from worlds.bags.user_bag_factory import SECOND, write_drive

from semantic_slam.bag.writer import BagWriter
from semantic_slam.messages import topics
from semantic_slam.messages.ground_truth import GroundTruthAssociations

STAMPS = [SECOND + index * SECOND // 5 for index in range(3)]


def annotated(folder, told, later_ns):
    """A drive with a cup and a bottle in each frame, and the true identities ``told`` by stamp."""
    with BagWriter(folder / "truth") as writer:
        for stamp, names in told.items():
            writer.write(topics.GROUND_TRUTH_ASSOCIATIONS, GroundTruthAssociations(stamp, names), stamp + later_ns)
    merge_bags(folder / "source", write_drive(folder / "drive", frames=len(STAMPS)), folder / "truth")
    (folder / "labels.yaml").write_text("cup: null\nbottle: flask\n")
    return folder / "source"


@pytest.mark.parametrize("later_ns", [-SECOND // 100, SECOND // 100])
def test_the_identity_of_a_dropped_detection_goes_with_it(tmp_path, monkeypatch, later_ns):
    told = {stamp: (f"cup {stamp}", f"bottle {stamp}") for stamp in STAMPS}
    source = annotated(tmp_path, told, later_ns)
    words = ("--labels", tmp_path / "labels.yaml")
    bag = import_bag(monkeypatch, "bag", source, *words, "--out", tmp_path / "bag")
    assert [frame.labels for frame in bag["/detections"]] == [("flask",)] * 3
    found = {item.stamp_ns: item.object_ids for item in bag[topics.GROUND_TRUTH_ASSOCIATIONS]}
    assert found == {stamp: (f"bottle {stamp}",) for stamp in STAMPS}
    all_kept = import_bag(monkeypatch, "bag", source, "--out", tmp_path / "all")[topics.GROUND_TRUTH_ASSOCIATIONS]
    assert {item.stamp_ns: item.object_ids for item in all_kept} == told


def test_identities_that_fit_no_frame_are_counted(tmp_path, monkeypatch, capsys):
    told = {STAMPS[0]: ("cup", "bottle"), STAMPS[1]: ("one too few",), STAMPS[2] + 1: ("cup", "bottle")}
    source = annotated(tmp_path, told, 0)
    run_import(monkeypatch, "bag", source, "--labels", tmp_path / "labels.yaml", "--out", tmp_path / "bag")
    kept = read_bag(tmp_path / "bag")[topics.GROUND_TRUTH_ASSOCIATIONS]
    assert [(item.stamp_ns, item.object_ids) for item in kept] == [(STAMPS[0], ("bottle",))]
    said = capsys.readouterr().out
    assert f"{topics.GROUND_TRUTH_ASSOCIATIONS}: no detections of their stamp 1" in said
    assert f"{topics.GROUND_TRUTH_ASSOCIATIONS}: not as many as the detections of their stamp 1" in said
