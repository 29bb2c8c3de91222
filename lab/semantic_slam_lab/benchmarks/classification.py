"""Chapter 3: time per step against the length of the track, and against Alg. 3.1 as printed; what a window costs."""

import time
from collections.abc import Callable

import numpy as np
from tqdm import tqdm

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import Scores, SequentialClassifier, View
from semantic_slam.classification.joint import JointClassifier
from semantic_slam.classification.processes import ClassProcesses
from semantic_slam.classification.recursive import RecursiveClassifier
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.peers.literal_alg_3_1 import LiteralRecursion

NUM_CLASSES, NUM_COMPONENTS, NUM_TRACKS, NUM_PASSES = 4, 4, 200, 50
TRAINING_VIEWS = 72
AT, FIRST, LAST = 40, 5, 80
WINDOWS = (5, 10, 20)
TRACK_LENGTH = 40


def class_models(seed: int) -> list[ClassModel]:
    """Random processes over the plane, a few metres of length scale."""
    random = np.random.default_rng(seed)
    inputs = random.normal(size=(TRAINING_VIEWS, 2)) * 6.0
    size = NUM_COMPONENTS
    length = np.stack([6.0 * np.eye(2)] * size)
    return [
        ClassModel(inputs, random.random((TRAINING_VIEWS, size)), np.full(size, 0.1), length, np.full(size, 0.05))
        for _ in range(NUM_CLASSES)
    ]


def growth(quick: bool, seed: int) -> list[Row]:
    """Time of a step for 200 tracks, fitted as a power of the number of views."""
    processes = ClassProcesses(class_models(seed))
    makers: dict[str, Callable[[], SequentialClassifier]] = {
        "recursive": lambda: RecursiveClassifier(processes, np.zeros(NUM_CLASSES), NUM_TRACKS),
        "joint": lambda: JointClassifier(processes, np.zeros(NUM_CLASSES), NUM_TRACKS),
    }
    repetitions = 1 if quick else 3
    rows = []
    for name, maker in makers.items():
        times = np.median([_step_seconds(maker(), seed + i) for i in range(repetitions)], axis=0)
        views = np.arange(FIRST, LAST + 1)
        exponent = float(np.polyfit(np.log(views), np.log(times[FIRST : LAST + 1]), 1)[0])
        at = float(np.median(times[AT - 2 : AT + 3]) * 1e3)
        how = (
            f"{name}: {NUM_TRACKS} tracks x {NUM_CLASSES} classes x {NUM_COMPONENTS} components, k = {FIRST}..{LAST};"
            f" ours: ms per step at k = {AT}; ratio: exponent of the fit"
        )
        rows.append(Row(f"classification_growth_exponent_{name}", at, float("nan"), "ms", exponent, repetitions, how))
    worst = max(rows, key=lambda row: row.ratio)
    plain = Row("classification_growth_exponent", worst.ours, worst.peer, worst.unit, worst.ratio, worst.n, worst.how)
    return [plain, *rows]


def against_literal(quick: bool, seed: int) -> list[Row]:
    """Our recursion against Alg. 3.1 as printed: one pose sample and one step at k = 40, its predecessor given."""
    models, random = class_models(seed), np.random.default_rng(seed)
    scores, track = _random_scores(random, AT + 1), np.cumsum(random.normal(size=(AT + 1, 2)), axis=0)
    repetitions = 3 if quick else 7
    literal, ours = LiteralRecursion(models), []
    tracks = track[:, None] + 0.3 * random.normal(size=(AT + 1, NUM_TRACKS, 2))
    for _ in range(repetitions):
        many = RecursiveClassifier(ClassProcesses(models), np.zeros(NUM_CLASSES), NUM_TRACKS)
        times = [_timed(many.update, View(tracks[k], scores[k])) for k in range(AT + 1)]
        ours.append(times[-1] / NUM_TRACKS)
    uniform = np.full(NUM_CLASSES, -np.log(NUM_CLASSES))
    peers = [_timed(literal.step, uniform, tracks[:, i], scores) for i in range(repetitions)]
    mine, theirs = float(np.median(ours)), float(np.median(peers))
    how = f"one step at k = {AT} for one pose sample; ours as one of {NUM_TRACKS} in a batch, the literal one by itself"
    return [
        Row("classification_vs_literal_k40", mine * 1e3, theirs * 1e3, "ms", theirs / mine, repetitions, how),
    ]


def window_loss(quick: bool, seed: int) -> list[Row]:
    """NLL of the true class after 40 views drawn from its process, with a window against all views."""
    processes = ClassProcesses(class_models(seed))
    count = 20 if quick else 100
    rows = []
    tracks = [_drawn_track(processes, np.random.default_rng([seed, i])) for i in range(count)]
    for name, maker in (("joint", JointClassifier), ("recursive", RecursiveClassifier)):
        whole = _mean_nll(maker(processes, np.zeros(NUM_CLASSES)), tracks)
        for window in WINDOWS:
            short = _mean_nll(maker(processes, np.zeros(NUM_CLASSES), window=window), tracks)
            how = f"{name}: NLL of the true class after {TRACK_LENGTH} views, last {window} against all; {count} tracks"
            rows.append(
                Row(f"classification_nll_{name}_window_{window}", short, whole, "nats", short / whole, count, how)
            )
    return rows


def _mean_nll(classifier: SequentialClassifier, tracks: list[tuple[int, list[View]]]) -> float:
    """Average over all steps of all tracks."""
    losses = []
    for true_class, views in tracks:
        fresh = classifier.empty(1)
        losses.append(np.mean([-fresh.update(view)[true_class] for view in views]))
    return float(np.mean(losses))


def _drawn_track(processes: ClassProcesses, random: np.random.Generator) -> tuple[int, list[View]]:
    true_class = int(random.integers(NUM_CLASSES))
    locations = np.cumsum(0.7 * random.normal(size=(TRACK_LENGTH, 2)), axis=0)
    mean, covariance = processes.posterior(locations)
    clean = np.stack(
        [random.multivariate_normal(mean[true_class, :, f], covariance[true_class, f]) for f in range(NUM_COMPONENTS)],
        axis=-1,
    )
    # The network errs by as much as its passes scatter.
    seen = clean + 0.3 * random.normal(size=clean.shape)
    clouds = seen[:, None] + 0.3 * random.normal(size=(TRACK_LENGTH, NUM_PASSES, NUM_COMPONENTS))
    return true_class, [View(locations[k][None], Scores.of(clouds[k])) for k in range(TRACK_LENGTH)]


def _step_seconds(classifier: SequentialClassifier, seed: int) -> Array:
    random = np.random.default_rng(seed)
    scores = _random_scores(random, LAST + 1)
    views = [View(6.0 * random.normal(size=(NUM_TRACKS, 2)), item) for item in scores]
    return np.array([_timed(classifier.update, view) for view in tqdm(views, desc="views", leave=False)])


def _random_scores(random: np.random.Generator, count: int) -> list[Scores]:
    return [Scores.of(random.normal(0.5, 0.1, (NUM_PASSES, NUM_COMPONENTS))) for _ in range(count)]


def _timed(call: Callable[..., object], *arguments: object) -> float:
    start = time.thread_time()
    call(*arguments)
    return time.thread_time() - start
