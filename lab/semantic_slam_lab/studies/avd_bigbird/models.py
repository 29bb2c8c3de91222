"""Class models over the unit circle from turntables, and which four of the network's scores they are of."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import normalised
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.datasets.avd.scene import AvdScene
from semantic_slam.datasets.bigbird import turntable_views
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.crops import square_crop
from semantic_slam.perception.networks.mc_dropout import class_probability_samples
from semantic_slam.perception.networks.weights import load_network
from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.avd_bigbird.data import SceneTrack, in_object_frame
from semantic_slam_lab.studies.rendered.models import fit_model

FeatureSets = dict[str, tuple[tuple[int, ...], Array]]
"""Name -> the scores chosen as features, and the (F,) ranking of all scores that they follow from."""

INPUT_MAP = "unit_circle"
CAMERA = "NP1"
"""The lowest ring, as in the thesis."""
NUM_PASSES = 50
NUM_COMPONENTS = 4
CROP_PX = 96
HEADINGS = 72


@dataclass(frozen=True)
class TurntableScores:
    """What the network says of one class from all around."""

    class_name: str
    directions: Array  # (M, 2) of the camera, on the unit circle
    samples: Array  # (M, T, F) of all the network's scores
    picture: Bytes  # (size, size, 3) of its first view


def measure_crop(crop_of: Bytes, box: Array, key: tuple[str | int, ...]) -> Array:
    """(T, F) dropout samples of what ``box`` holds of a picture; keyed."""
    network = load_network(PerceptionConfiguration()).network
    crop = square_crop(crop_of, box, network.input_size)
    return class_probability_samples(network, crop, NUM_PASSES, keyed_generator("avd_bigbird", *key))


def measure_turntables(folders: Sequence[Path], seed: int, jobs: int) -> list[TurntableScores]:
    """Every class's lowest ring through the network."""
    return repeat(_measure_turntable, [(folder, seed) for folder in folders], jobs, "turntables through the network")


def measure_track(scene: AvdScene, track: SceneTrack, seed: int) -> Array:
    """(K, T, F) dropout samples of the views of a track."""
    views = zip(track.images, track.boxes, strict=True)
    return np.stack([measure_crop(scene.image(name), box, ("scene", seed, name)) for name, box in views])


def feature_sets(measured: Sequence[TurntableScores], seed: int) -> FeatureSets:
    """Name -> four scores and the (F,) ranking they follow from: the greatest on average, and a forest's choice."""
    mean = np.concatenate([of.samples.mean(axis=1) for of in measured])
    labels = np.repeat(np.arange(len(measured)), [len(of.samples) for of in measured])
    rankings = {"mean_score": mean.mean(axis=0), "importance": _importance(mean, labels, seed)}
    return {
        name: (tuple(sorted(np.argsort(-ranking, kind="stable")[:NUM_COMPONENTS].tolist())), ranking)
        for name, ranking in rankings.items()
    }


def fit_models(measured: Sequence[TurntableScores], jobs: int) -> tuple[ClassModel, ...]:
    """Class models of every class, with a process for every score of the network."""
    tasks = (delayed(fit_model)(of.directions, of.samples.mean(axis=1), INPUT_MAP) for of in measured)
    return tuple(Parallel(n_jobs=jobs)(tasks))


def with_components(models: Sequence[ClassModel], components: Sequence[int]) -> tuple[ClassModel, ...]:
    """Class models of the chosen components of the scores alone."""
    chosen = list(components)
    return tuple(
        ClassModel(
            model.inputs,
            model.scores[:, chosen],
            model.signal_variance[chosen],
            model.length_squared[chosen],
            model.noise_sigma[chosen],
        )
        for model in models
    )


def class_processes(models: Sequence[ClassModel]) -> ClassProcesses:
    """Independent test-block noise, inputs of Eq. 3.47."""
    return ClassProcesses(models, test_noise="sigma_n", input_map=INPUT_MAP)


def single_view_posteriors(processes: ClassProcesses, score: Array, locations_m: Array) -> Array:
    """(N, C) by Model Based from one (F,) mean score believed to be seen from each of (N, 2) locations."""
    return np.exp(normalised(_log_likelihoods(processes, score, locations_m)))


def aligned(track: SceneTrack, scores: Array, processes: ClassProcesses, true_class: int) -> SceneTrack:
    """The track with the heading under which the true class explains (K, F) scores best, unless it is known."""
    if track.heading_known:
        return track
    candidates = [
        replace(track, planar=np.array([*track.planar[:2], yaw]))
        for yaw in np.linspace(0.0, 2.0 * np.pi, HEADINGS, endpoint=False)
    ]
    return max(candidates, key=lambda each: _fit(processes, scores, each, true_class))


def _fit(processes: ClassProcesses, scores: Array, track: SceneTrack, true_class: int) -> float:
    places = in_object_frame(track.cameras_m, track.planar)
    rows = [_log_likelihoods(processes, score, place[None])[0] for score, place in zip(scores, places, strict=True)]
    return float(np.stack(rows)[:, true_class].sum())


def _log_likelihoods(processes: ClassProcesses, score: Array, locations_m: Array) -> Array:
    """(N, C) in nats but for the factor of 2 pi."""
    found = processes.marginals(locations_m)
    squared = np.square(score - found.mean) / found.variance
    return np.asarray(-0.5 * (squared + np.log(found.variance)).sum(axis=-1))


def _measure_turntable(folder: Path, seed: int) -> TurntableScores:
    directions, samples, picture = [], [], None
    for view in turntable_views(folder, (CAMERA,)):
        if not view.mask.any():
            continue
        azimuth = view.viewpoint[0]
        directions.append([np.cos(azimuth), np.sin(azimuth)])
        samples.append(measure_crop(view.image, view.box, ("turntable", seed, folder.name, view.stem)))
        picture = square_crop(view.image, view.box, CROP_PX) if picture is None else picture
    if picture is None:
        raise InputError(f"{folder}: every mask of {CAMERA} is empty; restore the masks of the data set")
    return TurntableScores(folder.name, np.array(directions), np.stack(samples), picture)


def _importance(scores: Array, labels: NDArray[np.int_], seed: int) -> Array:
    """(F,) impurity that splits on a score remove in a random forest that tells the classes apart."""
    from sklearn.ensemble import RandomForestClassifier

    forest = RandomForestClassifier(n_estimators=200, random_state=seed, n_jobs=1)
    return np.asarray(forest.fit(scores, labels).feature_importances_)
