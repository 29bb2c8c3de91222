"""The methods that the rendered experiments compare, along tracks that are known."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed

from semantic_slam.classification.baselines import ModelBasedClassifier, SimpleBayesClassifier
from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import Scores, SequentialClassifier, View
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.processes import ClassProcesses, TestNoise, ViewNoise
from semantic_slam.classification.recursive import RecursiveClassifier
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.studies.rendered.models import INPUT_MAP
from semantic_slam_lab.studies.rendered.views import CLASSES

TEST_NOISES: tuple[TestNoise, ...] = ("none", "sigma_n")
LOG_PRIOR = np.full(len(CLASSES), -np.log(len(CLASSES)))


@dataclass(frozen=True)
class Method:
    """How to make one; ``view_noise`` tells whether sigma_n is independent between views or correlated as they are."""

    words: str
    make: Callable[[ClassProcesses], SequentialClassifier]
    view_noise: ViewNoise = "independent"

    def classifier(self, models: tuple[ClassModel, ...], test_noise: TestNoise) -> SequentialClassifier:
        """One that has seen nothing."""
        processes = ClassProcesses(models, test_noise=test_noise, view_noise=self.view_noise, input_map=INPUT_MAP)
        return self.make(processes)


def class_processes(models: tuple[ClassModel, ...], test_noise: TestNoise) -> ClassProcesses:
    """The class models with one of the two settings of the noise on the views of a track."""
    return ClassProcesses(models, test_noise=test_noise, input_map=INPUT_MAP)


def _joint(processes: ClassProcesses) -> SequentialClassifier:
    return JointClassifier(processes, LOG_PRIOR)


def _model_based(processes: ClassProcesses) -> SequentialClassifier:
    return ModelBasedClassifier(processes, LOG_PRIOR)


METHODS = {
    "joint": Method("joint process (our default)", _joint),
    "joint_kernel": Method("joint process, noise correlated between views", _joint, "kernel"),
    "recursive": Method("the thesis's recursion", lambda processes: RecursiveClassifier(processes, LOG_PRIOR)),
    "model_based": Method("Model Based", _model_based),
    "model_based_kernel": Method("Model Based, noise correlated between views", _model_based, "kernel"),
    "simple_bayes": Method("Simple Bayes", lambda processes: SimpleBayesClassifier(LOG_PRIOR)),
}
"""With ``none`` there is no noise that could be correlated, and "joint_kernel" is "joint"."""
OURS = {"method": "joint", "view_noise": METHODS["joint"].view_noise}
"""What the project's default is: the test block is that of all others."""


def classify(
    models: tuple[ClassModel, ...], test_noise: TestNoise, tracks_m: Array, samples: Array, jobs: int
) -> dict[str, Array]:
    """(N, K, C) log posteriors after every view by method, from (N, K, 2) tracks and (N, K, T, F) samples."""
    parts = np.array_split(np.arange(len(tracks_m)), jobs)
    tasks = (delayed(_classify)(models, test_noise, tracks_m[part], samples[part]) for part in parts if len(part))
    results = Parallel(n_jobs=jobs)(tasks)
    return {name: np.concatenate([result[name] for result in results]) for name in METHODS}


def follow(classifier: SequentialClassifier, track_m: Array, scores: list[Scores]) -> Array:
    """(K, C) log posteriors along one track, by a classifier that stays as it is."""
    own = classifier.empty(1)
    return np.stack([own.update(View(place[None], score)) for place, score in zip(track_m, scores, strict=True)])


def _classify(
    models: tuple[ClassModel, ...], test_noise: TestNoise, tracks_m: Array, samples: Array
) -> dict[str, Array]:
    scores = [[Scores.of(view) for view in track] for track in samples]
    found = {}
    for name, method in METHODS.items():
        classifier = method.classifier(models, test_noise)
        found[name] = np.stack([follow(classifier, *pair) for pair in zip(tracks_m, scores, strict=True)])
    return found
