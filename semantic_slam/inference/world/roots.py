"""Root components: what a hypothesis assumes before the first keyframe."""

from dataclasses import replace

import numpy as np

from semantic_slam.inference.models.correlated_errors import sensor_sigmas
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.smoothing.tracking import tracked_before
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.in_view import InViewRecord
from semantic_slam.inference.states.metre import Metre
from semantic_slam.inference.states.movers import Movers
from semantic_slam.inference.states.tracked_objects import HypothesisObjects
from semantic_slam.inference.world.departures import Departures
from semantic_slam.inference.world.problem import Problem
from semantic_slam.inference.world.starts import ANYWHERE


def closed_root(problem: Problem) -> Component:
    """Root component of a closed world: the priors of robot and mapped objects (Eq. 4.3)."""
    priors = {entry.object_id: entry.prior for entry in problem.objects}
    existence = {entry.object_id: entry.existence for entry in problem.objects}
    return Component.root(
        problem.spaces, problem.model, problem.robot, priors, problem.latent, existence, problem.joint
    )


def tracking_root(problem: Problem, root_number: int) -> Component:
    """Root component of an open world, which tracks states and existence, for a ``root_number`` (noise and start).

    A robot that is not localised in the map (start ANYWHERE) cannot observe the objects of the map.
    """
    noise_index = problem.noise_index_of(root_number)
    start = problem.start_of(root_number)
    robot = problem.robot if problem.starts is None else problem.starts.prior(start)
    plain = closed_root(replace(problem, robot=robot))
    is_elsewhere = problem.starts is not None and start == ANYWHERE
    objects = _tracked_objects(problem, plain.objects)
    entries = sorted(problem.objects, key=lambda entry: entry.object_id)
    single_steps = not problem.open_world.iterate_updates
    return replace(
        plain,
        objects=objects,
        smoother=_in_single_steps(problem, plain.smoother) if single_steps else plain.smoother,
        tracked=tracked_before(problem.spaces, robot, [entry.prior for entry in entries], problem.num_biases),
        single_steps=single_steps,
        noise_index=noise_index,
        start=start,
        elsewhere=plain.object_ids if is_elsewhere else frozenset(),
        noise_settings=problem.noise_settings[noise_index],
        metre=None if problem.objects or not problem.sigma_metre else Metre(problem.sigma_metre, robot.mean[:2]),
        movers=_movers(problem, objects.rates),
    )


def _tracked_objects(problem: Problem, stated: HypothesisObjects) -> HypothesisObjects:
    """The objects of the map for each setting of the detection rates, some departed since it was made."""
    rates = DetectionRates.of(problem.open_world)
    shape = len(stated.ids), len(rates)
    existence = np.broadcast_to(stated.existence_given, shape)
    share = problem.open_world.departed_share
    detectable = np.broadcast_to(rates.runs.share, shape) if rates.misses_in_runs else None
    return replace(
        stated,
        existence_given=(1.0 - share) * existence,
        in_view=InViewRecord.unknown(detectable, *shape),
        gone=share * existence if Departures(problem.open_world).is_on else None,
        rates=rates,
    )


def _movers(problem: Problem, rates: DetectionRates) -> Movers | None:
    """The empty table of moving objects; None: nothing moves."""
    moving = problem.moving
    if not moving.is_on:
        return None
    return Movers.none(moving.stands, len(rates), rates.misses_in_runs, len(moving.sensor_sigmas))


def _in_single_steps(problem: Problem, smoother: Smoother) -> Smoother:
    """The smoother configured for a single (not iterated) update per keyframe.

    Constant errors of the sensor and what else repeats are known together far better than apart: that takes QR.
    """
    errors = problem.detection_errors
    return smoother.with_single_steps(
        problem.num_biases,
        errors_repeat=errors.correlated_share > 0.0,
        factorization="QR" if len(sensor_sigmas(errors)) else "CHOLESKY",
    )
