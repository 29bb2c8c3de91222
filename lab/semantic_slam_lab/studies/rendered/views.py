"""What the network says of a piece of furniture seen from any place around it: rendered, cropped, dropout."""

from dataclasses import dataclass

import cv2
import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.crops import square_crop
from semantic_slam.perception.networks.mc_dropout import class_probability_samples
from semantic_slam.perception.networks.weights import load_network
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject, scene_xml
from semantic_slam_lab.simulation.renderer import Renderer, camera_model

CLASSES = ("chest", "crate", "desk")
"""Candidates of chapter 3's rendered experiments; the shipped network knows two classes more."""
CAMERA_HEIGHT_M = 0.9
IMAGE_SIZE_PX = 224
FIELD_OF_VIEW_RAD = float(np.deg2rad(68.0))
NUM_PASSES = 50
LEAST_RANGE_M = 1.0
"""Nearer to the object's centre it does not fit into the picture."""
VIEWS_PER_TASK = 50


@dataclass(frozen=True)
class Subject:
    """One object, alone; the face that shows ``recoloured`` (a picture's name) is of one plain ``colour`` instead."""

    class_name: str
    recoloured: str = ""
    colour: tuple[int, int, int] = (0, 0, 0)  # RGB


@dataclass(frozen=True)
class Picture:
    """What the camera sees."""

    image: NDArray[np.uint8]  # (H, W, 3) RGB
    mask: NDArray[np.bool_]  # (H, W) where the object is

    def crop(self, size: int) -> NDArray[np.uint8]:
        """(size, size, 3) about the object, as a detector's box would cut it out."""
        rows, columns = np.flatnonzero(self.mask.any(axis=1)), np.flatnonzero(self.mask.any(axis=0))
        box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float64)
        return square_crop(self.image, box, size)


def measure(subject: Subject, locations_m: Array, seed: tuple[int, ...], jobs: int, name: str) -> Array:
    """(N, 2) locations of the camera relative to the object to (N, T, F) dropout samples.

    The F components are the network's probabilities of ``CLASSES``, scaled to sum to one: only these are candidates.
    Dropout is keyed by ``seed`` and the number of the view, whatever the number of processes.
    """
    starts = range(0, len(locations_m), VIEWS_PER_TASK)
    tasks = (delayed(_measure)(subject, locations_m[i : i + VIEWS_PER_TASK], (*seed, i)) for i in starts)
    parts = tqdm(Parallel(n_jobs=jobs, return_as="generator")(tasks), total=len(starts), desc=name, unit="block")
    return np.concatenate(list(parts))


def pictures(subject: Subject, locations_m: Array) -> list[Picture]:
    """From (N, 2) locations, always towards the middle of the object."""
    placed = PlacedObject(1, subject.class_name, subject.class_name, 0.0, 0.0, 0.0)
    xml, assets = scene_xml([placed], room=None)
    if subject.recoloured:
        plain = np.full((8, 8, 3), subject.colour[::-1], dtype=np.uint8)
        assets[f"{subject.recoloured}.png"] = cv2.imencode(".png", plain)[1].tobytes()
    target_height_m = placed.model.size[2] / 2.0
    with Renderer(xml, assets, camera_model(IMAGE_SIZE_PX, IMAGE_SIZE_PX, FIELD_OF_VIEW_RAD)) as renderer:
        views = [renderer.render(camera_pose(location, target_height_m)) for location in locations_m]
    return [Picture(view.image, view.body_ids == 1) for view in views]


def camera_pose(location_m: Array, target_height_m: float) -> Array:
    """(4, 4) pose of a camera over (2,) ``location_m`` that looks at the middle of the object."""
    position = np.array([*location_m, CAMERA_HEIGHT_M])
    forward = np.array([0.0, 0.0, target_height_m]) - position
    forward /= np.linalg.norm(forward)
    right = np.array([forward[1], -forward[0], 0.0]) / np.hypot(forward[0], forward[1])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose


def _measure(subject: Subject, locations_m: Array, seed: tuple[int, ...]) -> Array:
    classifier = load_network(PerceptionConfiguration())
    columns = [classifier.class_names.index(name) for name in CLASSES]
    samples = []
    for index, picture in enumerate(pictures(subject, locations_m)):
        generator = np.random.default_rng((*seed, index))
        crop = picture.crop(classifier.network.input_size)
        drawn = class_probability_samples(classifier.network, crop, NUM_PASSES, generator)
        samples.append(classifier.reported(drawn)[:, columns])
    chosen = np.stack(samples)
    return np.asarray(chosen / chosen.sum(axis=-1, keepdims=True))
