"""What each option of ``config/uncalibrated.yaml`` costs: keyframes with it against keyframes with none of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from semantic_slam.configuration import (
    Configuration,
    DetectionErrorsConfiguration,
    MovingConfiguration,
    OpenWorldConfiguration,
    RevisionConfiguration,
    load_configuration,
)
from semantic_slam.inference.building import initial_pose_of, make_run_configuration, problem_of
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.noise.noise_settings import DISTANCE
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.benchmarks.row import Row, cpu_seconds
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.faulty_rooms.open_room import open_room

KEYFRAMES, QUICK_KEYFRAMES = 60, 3
HYPOTHESES = 20
"""At most, with every option: so that an option costs what it costs, and not what more hypotheses do."""
RESAMPLED, STRETCH = 2000, 5
"""Bootstrap of the ratio: draws, and keyframes that stay together in one, as those near a look back belong together."""
ALL = "all"

Switch = Callable[[Configuration, Configuration], Configuration]
"""Configuration, and the shipped one with all options -> the first one with an option of the other."""


def bare_configuration(shipped: Configuration) -> Configuration:
    """The shipped configuration with every option off: independent errors as stated, known rates, no look back."""
    odometry = replace(shipped.odometry, estimate_bias=False, noise_factors=(1.0,))
    perception = replace(shipped.perception, noise_factors=(1.0,), ranges_are=(DISTANCE,), sigma_range_scale=0.0)
    world = replace(OpenWorldConfiguration(), iterate_updates=False, occluder_radius_m=0.0)
    return replace(
        shipped,
        odometry=odometry,
        perception=perception,
        detection_errors=DetectionErrorsConfiguration(),
        open_world=replace(world, max_joint_objects=shipped.open_world.max_joint_objects),
        moving=MovingConfiguration(),
        revision=RevisionConfiguration(),
        weights=replace(shipped.weights, bagged_sets=0),
        pruning=replace(shipped.pruning, max_hypotheses=HYPOTHESES),
    )


def _correlated_errors(base: Configuration, shipped: Configuration) -> Configuration:
    return replace(base, detection_errors=shipped.detection_errors)


def _range_scale(base: Configuration, shipped: Configuration) -> Configuration:
    scale = shipped.perception.sigma_range_scale
    return replace(_correlated_errors(base, shipped), perception=replace(base.perception, sigma_range_scale=scale))


def _outliers(base: Configuration, shipped: Configuration) -> Configuration:
    return replace(base, detection_errors=replace(base.detection_errors, outlier_share=0.02))


def _odometry_bias(base: Configuration, shipped: Configuration) -> Configuration:
    return replace(base, odometry=replace(base.odometry, estimate_bias=True))


def _noise_scales(base: Configuration, shipped: Configuration) -> Configuration:
    own = shipped.perception
    perception = replace(base.perception, noise_factors=own.noise_factors, ranges_are=own.ranges_are)
    odometry = replace(base.odometry, noise_factors=shipped.odometry.noise_factors)
    return replace(base, perception=perception, odometry=odometry)


def _detection_rates(base: Configuration, shipped: Configuration) -> Configuration:
    names = "detection_probabilities", "detection_half_ranges_m", "clutters_per_frame", "birth_densities"
    return _with_open_world(base, shipped, names)


def _misses_in_runs(base: Configuration, shipped: Configuration) -> Configuration:
    return _with_open_world(base, shipped, ("miss_persistences",))


def _learned_region(base: Configuration, shipped: Configuration) -> Configuration:
    return _with_open_world(base, shipped, ("learn_region",))


def _learned_scores(base: Configuration, shipped: Configuration) -> Configuration:
    return _with_open_world(base, shipped, ("learn_scores",))


def _departures(base: Configuration, shipped: Configuration) -> Configuration:
    return _with_open_world(base, shipped, ("departures_per_hour",))


def _moving_objects(base: Configuration, shipped: Configuration) -> Configuration:
    return replace(base, moving=replace(base.moving, share=0.05))


def _revision(base: Configuration, shipped: Configuration) -> Configuration:
    return replace(base, revision=shipped.revision)


def _bagged_evidence(base: Configuration, shipped: Configuration) -> Configuration:
    return replace(base, weights=replace(base.weights, bagged_sets=shipped.weights.bagged_sets))


def _all(base: Configuration, shipped: Configuration) -> Configuration:
    return replace(shipped, pruning=base.pruning)


@dataclass(frozen=True)
class Option:
    """One option, and the parameters that it is."""

    switch: Switch
    parameters: str


OPTIONS: Mapping[str, Option] = MappingProxyType(
    {
        "correlated_errors": Option(_correlated_errors, "detection_errors.correlated_share"),
        "range_scale": Option(_range_scale, "perception.sigma_range_scale, with correlated errors"),
        "odometry_bias": Option(_odometry_bias, "odometry.estimate_bias"),
        "noise_scales": Option(_noise_scales, "noise_factors of odometry and perception, ranges_are"),
        "detection_rates": Option(_detection_rates, "lists of detection, clutter and birth rates"),
        "misses_in_runs": Option(_misses_in_runs, "open_world.miss_persistences"),
        "learned_region": Option(_learned_region, "open_world.learn_region"),
        "learned_scores": Option(_learned_scores, "open_world.learn_scores"),
        "departures": Option(_departures, "open_world.departures_per_hour"),
        "revision": Option(_revision, "revision"),
        "bagged_evidence": Option(_bagged_evidence, "weights.bagged_sets"),
        ALL: Option(_all, "all options of uncalibrated.yaml; there are no labels, by which things may move"),
        "outliers": Option(_outliers, "detection_errors.outlier_share: 0.02, which uncalibrated.yaml has not"),
        "moving_objects": Option(_moving_objects, "moving.share: 0.05, which uncalibrated.yaml has by label alone"),
    }
)


@dataclass
class _Timed:
    """An engine, the CPU seconds of its keyframes, and the hypotheses that it followed at each."""

    engine: Engine
    seconds: list[float] = field(default_factory=list)
    hypotheses: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, configuration: Configuration) -> "_Timed":
        """Before any keyframe."""
        pose, covariance = initial_pose_of(configuration)
        run = make_run_configuration(configuration, None, pose, covariance, stamp_ns=0)
        problem = problem_of(run)
        return cls(Engine.of_run(run, InProcessPool(1, problem), problem))

    def process(self, keyframe: Keyframe) -> None:
        """Infer, timed."""
        self.seconds.append(cpu_seconds(lambda: self.engine.process(keyframe)))
        self.hypotheses.append(len(self.engine.hypotheses))


def costs(quick: bool, seed: int) -> list[Row]:
    """A row for each option and one for all: they meet each keyframe in turn, so that all meet the same machine."""
    shipped = load_configuration(configuration_file("uncalibrated"))
    bare, count = bare_configuration(shipped), QUICK_KEYFRAMES if quick else KEYFRAMES
    keyframes = _drive(bare, count, seed)
    peer, ours = _Timed.of(bare), {name: _Timed.of(own.switch(bare, shipped)) for name, own in OPTIONS.items()}
    for keyframe in keyframes:
        for timed in (peer, *ours.values()):
            timed.process(keyframe)
    return [_row(name, timed, peer, seed) for name, timed in ours.items()]


def interval(ours: Sequence[float], peer: Sequence[float], random: np.random.Generator) -> tuple[float, float]:
    """95 % interval of the ratio of sums by a bootstrap of stretches of keyframes, both drawn alike."""
    starts = np.arange(0, len(ours), STRETCH)
    sums = np.add.reduceat(np.array([ours, peer]), starts, axis=1)
    drawn = sums[:, random.integers(len(starts), size=(RESAMPLED, len(starts)))].sum(axis=2)
    low, high = np.quantile(drawn[0] / drawn[1], [0.025, 0.975])
    return float(low), float(high)


def _row(name: str, ours: _Timed, peer: _Timed, seed: int) -> Row:
    mine, theirs = float(np.mean(ours.seconds)), float(np.mean(peer.seconds))
    followed = f"{np.mean(ours.hypotheses):.0f} against {np.mean(peer.hypotheses):.0f} hypotheses"
    asked = "; at most 2 is asked for" if name == ALL else ""
    how = (
        f"mean keyframe of an open room, geometry alone, at most {HYPOTHESES} hypotheses; {OPTIONS[name].parameters};"
        f" against none: {followed}{_told(ours.seconds, peer.seconds, name, seed)}{asked}"
    )
    return Row(f"option_{name}", mine * 1e3, theirs * 1e3, "ms", mine / theirs, len(ours.seconds), how)


def _told(ours: Sequence[float], peer: Sequence[float], name: str, seed: int) -> str:
    """The interval of the ratio in words; nothing where there is no second stretch of keyframes."""
    if len(ours) <= STRETCH:
        return ""
    low, high = interval(ours, peer, keyed_generator("option_costs", "bootstrap", name, seed))
    return f"; 95 % interval {low:.2f} to {high:.2f}"


def _drive(configuration: Configuration, count: int, seed: int) -> list[Keyframe]:
    """Keyframes of an open room, a second apart, of which places alone are told."""
    drawn = replace(configuration, semantic_model=replace(configuration.semantic_model, kind="gp_independent"))
    room = open_room(drawn, count, keyed_generator("option_costs", seed))
    return [_without_scores(keyframe) for keyframe in room.keyframes]


def _without_scores(keyframe: Keyframe) -> Keyframe:
    measured = keyframe.measurements
    told = replace(
        measured,
        class_probability_samples=np.zeros((len(measured), 0, 0)),
        features=np.zeros((len(measured), 0)),
        feature_covariances=np.zeros((len(measured), 0, 0)),
    )
    return replace(keyframe, measurements=told)


def _with_open_world(base: Configuration, shipped: Configuration, names: Sequence[str]) -> Configuration:
    """With these parameters of the shipped open world."""
    taken = {name: getattr(shipped.open_world, name) for name in names}
    return replace(base, open_world=replace(base.open_world, **taken))
