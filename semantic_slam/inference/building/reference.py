"""Construction of a run's null (reference) model, against which the belief's fit to the data is measured."""

import json

from semantic_slam.class_models.detector import load_label_model
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import from_dict
from semantic_slam.inference.building.views import tempering
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.reference import NO_SCORES, EvenWords, KeyframeScores, Reference, ScoreDensity
from semantic_slam.inference.reference.places import EvenPlaces
from semantic_slam.inference.reference.planar import PlanarPlaces
from semantic_slam.inference.reference.scores import IN_SPACE, LEVEL
from semantic_slam.inference.reference.spatial import SpatialPlaces
from semantic_slam.inference.world.problem import Problem


def reference_of(run: RunConfiguration, problem: Problem) -> Reference:
    """The null model of a run, see ``Reference``; ``problem`` is the one built from the run's announcement."""
    configuration = from_dict(json.loads(run.configuration), "run configuration")
    settings = configuration.semantic_model
    model, labels = load_model(settings), load_label_model(settings)
    scores: KeyframeScores = NO_SCORES
    if labels is not None:
        scores = EvenWords(labels.num_words)
    elif model is not None:
        elevations = IN_SPACE if configuration.is_spatial else LEVEL
        scores = ScoreDensity.of_classes(model, tempering(settings), elevations)
    elif problem.latent is not None:
        scores = ScoreDensity.of_descriptors(problem.latent)
    is_open = problem.association.tracks_objects
    places: EvenPlaces = PlanarPlaces.of(configuration, is_open=is_open)
    if configuration.is_spatial:
        places = SpatialPlaces.of(configuration, problem, is_open=is_open)
    return Reference(configuration, problem, places, scores)
