"""Chooses the configuration of a run for which none was given, by the labels of its detections and of its map."""

from dataclasses import dataclass
from pathlib import Path

from semantic_slam.bag.reader import BagReader
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import load_configuration
from semantic_slam.inference.world.map_prior import MapPrior, read_map_prior
from semantic_slam.pipeline.detector_labels import OF_ANYTHING, classes_in, labels_in, scored_classes_in
from semantic_slam.pipeline.input_topics import find_topics
from semantic_slam.pipeline.preamble import map_prior_path
from semantic_slam.shipped import DEFAULT_CONFIGURATION, configuration_file

DETECTOR, SECOND_SESSION = "detector", "detector_second_session"
MOST_NAMED = 3
"""Maximum number of labels named in the printed line."""


@dataclass(frozen=True, kw_only=True)
class _Labels:
    """The words for classes that a run has to do with."""

    told: frozenset[str]  # by the bag's detections; without those of class-agnostic detectors
    mapped: frozenset[str] | None  # classes of the map's objects; None: no map
    known: frozenset[str]  # classes of the default's class models
    have_evidence: bool  # for the default's class models: images, measurements, or a score for each of their classes

    @property
    def need_second_session(self) -> bool:
        """Whether the default, though there is a map, would refuse this map's classes or these detections."""
        if self.mapped is None:
            return False
        return not self.have_evidence or (bool(self.told) and not self.mapped <= self.known)

    @property
    def need_detector(self) -> bool:
        """Whether the default's classifier lacks some of these labels, or has nothing to go by."""
        return not self.have_evidence or bool(self.told - self.known)

    @property
    def named(self) -> str:
        """The first few labels, those that the default's classifier does not have before the others."""
        labels = sorted(self.told - self.known) or sorted(self.told)
        shown = ", ".join(labels[:MOST_NAMED]) + (", …" if len(labels) > MOST_NAMED else "")
        return f"labels ({shown})" if labels else "places without classes"


def configuration_for(bag: Path, prior: MapPrior | None = None) -> Path:
    """Configuration file that suits a bag and its map; if it is not the default one, a line about it is printed.

    The default's network knows five classes of furniture. Detections with other labels get the detector configuration,
    and so do those without pictures and without scores of these five; with a map (``prior``, or the one beside the
    bag) that of a second session if there is no such evidence, or if labelled detections are of a map with other
    classes, too. Raises InputError if the bag or the map cannot be used.
    """
    beside = map_prior_path(bag) if prior is None else None
    labels = _labels(bag, read_map_prior(beside) if beside is not None else prior)
    if labels.need_second_session:
        print(
            f"{bag}: {labels.named} and a map that the default's classifier cannot go on with;"
            f" using config/{SECOND_SESSION}.yaml, which goes by the detector's labels (--config for another)"
        )
        return configuration_file(SECOND_SESSION)
    if labels.need_detector:
        print(
            f"{bag}: {labels.named}, which the default's classifier cannot go by; using"
            f" config/{DETECTOR}.yaml, which goes by the detector's labels (--config for another)"
        )
        return configuration_file(DETECTOR)
    return DEFAULT_CONFIGURATION


def _labels(bag: Path, prior: MapPrior | None) -> _Labels:
    known = _classes()
    with BagReader(bag) as reader:
        found = find_topics(bag, reader.topics)
        told = labels_in(reader, found.measurements or found.detections)
        scored = scored_classes_in(reader, found.detections) if found.has_places_alone else known
    return _Labels(
        told=told - OF_ANYTHING,
        mapped=classes_in(prior) if prior is not None else None,
        known=known,
        have_evidence=scored is None or scored == known,
    )


def _classes() -> frozenset[str]:
    """Class names of the default configuration's class models."""
    model = load_model(load_configuration(DEFAULT_CONFIGURATION).semantic_model)
    return frozenset(model.class_names) if model is not None else frozenset()
