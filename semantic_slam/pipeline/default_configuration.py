"""The configuration of a run that was told none: the default one, or that of a detector's labels."""

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
"""Labels that the announcement names."""


def configuration_for(bag: Path, *, has_map: bool = False) -> Path:
    """File of the configuration that suits a bag's detections, announced in a line where it is not the default one.

    The default's network knows five kinds of furniture: where detections have other labels, these are gone by. On a
    map (``has_map``, or one beside the bag) detections without pictures are used by their places, as the default has
    it. Raises InputError where the bag cannot be used.
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
    """What the default's class models call objects."""
    model = load_model(load_configuration(DEFAULT_CONFIGURATION).semantic_model)
    return model.class_names if model is not None else ()
