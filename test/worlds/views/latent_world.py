"""The planar world and the open room with features of the harmonic model: the descriptor of every object is known."""

from dataclasses import dataclass, replace

import numpy as np
from worlds.drives.open_room import OBJECTS as ROOM
from worlds.drives.open_room import make_room
from worlds.scenes.planar_world import OBJECTS, make_world
from worlds.views.harmonic_model import HarmonicModel

from semantic_slam.inference.building import problem_of
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.inputs.planar_reader import PlanarReader
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.planar.observation import POSES_IN_PLANE
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.semantics.descriptors.descriptor_tables import DescriptorTables
from semantic_slam.inference.semantics.descriptors.descriptor_views import DescriptorViews
from semantic_slam.inference.world.problem import Problem

MODEL = HarmonicModel()
SPACES = POSES_IN_PLANE


@dataclass(frozen=True)
class LatentWorld:
    run: RunConfiguration
    problem: Problem
    keyframes: list[Keyframe]
    truth: np.ndarray  # (K, 3)
    associations: list[tuple[int, ...]]
    descriptors: np.ndarray  # (O, L)

    def manager(self) -> Engine:
        return Engine.of_run(self.run, InProcessPool(1, self.problem), self.problem)


def make_latent_world(num_keyframes: int = 12, seed: int = 0, model: HarmonicModel = MODEL, **settings) -> LatentWorld:
    """``settings`` are those of the planar world."""
    world = make_world(num_keyframes, seed, **{"semantic_model": {"kind": "none"}, **settings})
    random = np.random.default_rng(1000 + seed)
    descriptors = random.normal(size=(len(OBJECTS), model.num_dimensions))
    keyframes = [
        _with_features(frame, x, list(seen), descriptors, model, random)
        for frame, x, seen in zip(world.keyframes, world.truth, world.associations, strict=True)
    ]
    run = replace(world.run, class_names=model.class_names)
    return LatentWorld(run, latent_problem_of(run, model), keyframes, world.truth, world.associations, descriptors)


def make_latent_room(num_keyframes: int = 30, seed: int = 0, model: HarmonicModel = MODEL, **settings) -> LatentWorld:
    """The open room; false alarms look like anything."""
    room = make_room(num_keyframes, seed, **settings)
    random = np.random.default_rng(2000 + seed)
    descriptors = random.normal(size=(len(ROOM), model.num_dimensions))
    keyframes = []
    for frame, x, labels in zip(room.keyframes, room.truth, room.associations, strict=True):
        places = np.array([ROOM[n] if n >= 0 else random.uniform(-3.0, 3.0, 3) for n in labels]).reshape(-1, 3)
        looks = np.array([descriptors[n] if n >= 0 else random.normal(size=model.num_dimensions) for n in labels])
        keyframes.append(_seen(frame, x, places, looks.reshape(-1, model.num_dimensions), model, random))
    run = replace(room.run, class_names=model.class_names)
    plain = latent_problem_of(run, model)
    problem = replace(plain, semantics=DescriptorTables(plain.latent))
    return LatentWorld(run, problem, keyframes, room.truth, room.associations, descriptors)


def latent_problem_of(run: RunConfiguration, model: HarmonicModel) -> Problem:
    observation = LatentObservation(model)
    plain = problem_of(run)
    reader = PlanarReader(model.num_features)
    return replace(plain, reader=reader, semantics=DescriptorViews(observation), latent=observation, clutter=None)


def _with_features(frame: Keyframe, x: np.ndarray, seen: list[int], descriptors, model, random) -> Keyframe:
    return _seen(frame, x, OBJECTS[seen], descriptors[seen], model, random)


def _seen(frame: Keyframe, x: np.ndarray, places: np.ndarray, descriptors, model, random) -> Keyframe:
    count = len(places)
    views = SPACES.viewpoints(np.tile(x, (count, 1)), places, np.zeros(2))
    prediction = model.predict(views, descriptors)
    features = prediction.mean + prediction.sigma * random.normal(size=prediction.mean.shape)
    size = model.num_features
    measured = replace(frame.measurements, features=features, feature_covariances=np.zeros((count, size, size)))
    return replace(frame, measurements=measured)
