"""A detector's labels become names: of bags with pictures and without, with nothing trained and nothing loaded."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import OBJECTS, Entry, input_entries, of_topic, write_bag, write_configuration
from worlds.bags.imported import read_bag
from worlds.bags.places import NUM_FRAMES, place_entries

from semantic_slam.configuration import load_configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.viewpoint.labels.model import NONE_OF_THESE

DETECTOR = {"kind": "detector"}
MAPPED = {"sofa": 0.7, "cup": 0.2, NONE_OF_THESE: 0.1}


def labelled(entries: list[Entry], *labels: str, **others: object) -> list[Entry]:
    """The detections of every frame, from the first on called by the labels in turn."""
    for entry in of_topic(entries, topics.DETECTIONS):
        found = from_message(entry.message)
        entry.message = to_message(replace(found, labels=labels[: len(found)], **others))
    return entries


def run(folder, entries, **changes):
    """What the pipeline makes of a bag, its network's file not being there."""
    perception = {"network": "nowhere.safetensors"}
    settings = write_configuration(
        folder / "configuration", **{"perception": perception, "association": "open"} | changes
    )
    run_bag(write_bag(folder / "bag", entries), folder / "belief", load_configuration(settings))
    return read_bag(folder / "belief")


def names(belief) -> set[str]:
    best = belief.class_probabilities[belief.existence > 0.5].argmax(axis=1)
    return {belief.class_names[number] for number in best}


@pytest.mark.parametrize("entries", [place_entries("ranges"), input_entries(NUM_FRAMES)], ids=["places", "pictures"])
def test_objects_are_called_what_the_detector_calls_them(tmp_path, entries):
    bag = run(tmp_path, labelled(entries, "chair", "cup"), semantic_model=DETECTOR)
    last = bag["/hypothesis_manager/belief"][-1]
    assert last.class_names == ("chair", "cup", NONE_OF_THESE)
    assert names(last) == {"chair", "cup"}


def test_scores_of_all_classes_are_kept_and_name_the_classes(tmp_path):
    scores = np.array([[0.6, 0.2, np.nan], [np.nan, 0.5, 0.1]])
    entries = labelled(
        input_entries(NUM_FRAMES), "chair", "cup", class_names=("chair", "cup", "tv"), class_scores=scores
    )
    bag = run(tmp_path, entries, semantic_model=DETECTOR)
    np.testing.assert_array_equal(bag["/classifier/measurements"][0].class_scores, scores)
    assert bag["/hypothesis_manager/belief"][-1].class_names == ("chair", "cup", "tv", NONE_OF_THESE)


def test_what_is_not_listed_is_none_of_these(tmp_path):
    listed = {**DETECTOR, "labels": ["chair"]}
    bag = run(tmp_path, labelled(place_entries("ranges"), "chair", "cup"), semantic_model=listed)
    assert names(bag["/hypothesis_manager/belief"][-1]) == {"chair", NONE_OF_THESE}


def test_detections_without_labels_are_an_error_with_a_remedy(tmp_path):
    with pytest.raises(InputError, match=r"nothing tells which labels.*list them in semantic_model\.labels"):
        run(tmp_path, labelled(place_entries("ranges"), "", ""), semantic_model=DETECTOR)


def test_labels_that_the_network_cannot_mean_are_an_error_at_the_start(tmp_path):
    with pytest.raises(InputError, match=r"labelled 'refrigerator'.*none of the classes.*kind: detector"):
        run(
            tmp_path,
            labelled(input_entries(NUM_FRAMES), "cabinet", "refrigerator"),
            semantic_model={"kind": "gp_independent"},
            perception={"network": "", "num_passes": 2},
        )
    assert not (tmp_path / "belief" / "belief.mcap").exists() or "/hypothesis_manager/belief" not in read_bag(
        tmp_path / "belief"
    )


@pytest.mark.slow
@pytest.mark.parametrize("label", ["object", "cabinet", ""])
def test_labels_that_it_can_mean_are_none(tmp_path, label):
    semantic_model, perception = {"kind": "gp_independent"}, {"network": "", "num_passes": 2}
    entries = labelled(input_entries(2), label, label)
    assert run(tmp_path, entries, semantic_model=semantic_model, perception=perception)["/hypothesis_manager/belief"]


@pytest.mark.parametrize("updates", [True, False], ids=["iterated", "single steps"])
def test_names_go_with_given_identities_too(tmp_path, updates):
    entries = labelled(place_entries("ranges", track_ids=("1", "2")), "chair", "cup")
    world = {"iterate_updates": updates}
    bag = run(tmp_path, entries, association="given", open_world=world, semantic_model=DETECTOR)
    last = bag["/hypothesis_manager/belief"][-1]
    assert dict(zip(last.object_names, last.class_probabilities.argmax(axis=1), strict=True)) == {
        "box 1": 0,
        "box 2": 1,
    }


def test_names_go_with_what_moves_and_with_noise_that_is_inferred(tmp_path):
    changes = {
        "open_world": {"iterate_updates": False},
        "moving": {"share_by_label": ["cup=0.3"]},
        "odometry": {"noise_factors": [1.0, 4.0]},
        "perception": {"network": "nowhere.safetensors", "noise_factors": [1.0, 4.0]},
    }
    bag = run(tmp_path, labelled(place_entries("ranges"), "chair", "cup"), semantic_model=DETECTOR, **changes)
    assert names(bag["/hypothesis_manager/belief"][-1]) == {"chair", "cup"}


def test_a_map_that_such_a_run_made_is_one_for_the_next(tmp_path):
    """Of an object with a name that the next bag does not have."""
    known = [
        ObjectPrior.planar(n, x, y, sigma_m=0.1, sigma_rad=0.1, class_probabilities=MAPPED)
        for n, (x, y) in enumerate(OBJECTS[:, :2])
    ]
    settings = write_configuration(tmp_path / "configuration", semantic_model=DETECTOR, association="enumerated")
    bag = write_bag(tmp_path / "bag", labelled(place_entries("ranges"), "chair", "cup"))
    run_bag(bag, tmp_path / "belief", load_configuration(settings), map_prior=MapPrior(tuple(known)))
    last = read_bag(tmp_path / "belief")["/hypothesis_manager/belief"][-1]
    assert last.class_names == ("chair", "cup", "sofa", NONE_OF_THESE)
    assert set(last.class_names) >= names(last) and "cup" in names(last)
