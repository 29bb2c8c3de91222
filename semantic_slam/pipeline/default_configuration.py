"""Chooses the configuration of a run for which none was given: the default one or config/detector.yaml."""

from pathlib import Path

from semantic_slam.bag.reader import BagReader
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import load_configuration
from semantic_slam.pipeline.detector_labels import OF_ANYTHING, labels_in
from semantic_slam.pipeline.input_topics import find_topics
from semantic_slam.pipeline.preamble import map_prior_path
from semantic_slam.shipped import DEFAULT_CONFIGURATION, configuration_file

DETECTOR = "detector"
MOST_NAMED = 3
"""Maximum number of labels named in the printed line."""


def configuration_for(bag: Path, *, has_map: bool = False) -> Path:
    """Configuration file that suits a bag's detections; if it is not the default one, a line about it is printed.

    The default's network knows five classes of furniture; for detections with other labels the detector configuration
    uses these labels instead. With a map (``has_map``, or one beside the bag) detections without images are used by
    their positions, with the default configuration. Raises InputError if the bag cannot be used.
    """
    with BagReader(bag) as reader:
        found = find_topics(bag, reader.topics)
        if found.has_places_alone and (has_map or map_prior_path(bag) is not None):
            return DEFAULT_CONFIGURATION
        labels = labels_in(reader, found.measurements or found.detections)
    strange = sorted(labels - set(_classes()) - OF_ANYTHING)
    if not strange:
        return DEFAULT_CONFIGURATION
    named = ", ".join(strange[:MOST_NAMED]) + (", …" if len(strange) > MOST_NAMED else "")
    print(
        f"{bag}: labels ({named}) that the default's classifier does not have; using config/{DETECTOR}.yaml, which goes"
        " by the detector's labels (--config for another)"
    )
    return configuration_file(DETECTOR)


def _classes() -> tuple[str, ...]:
    """Class names of the default configuration's class models."""
    model = load_model(load_configuration(DEFAULT_CONFIGURATION).semantic_model)
    return model.class_names if model is not None else ()
