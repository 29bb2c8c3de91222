"""Model parameters refined on some of the tracks (Eq. 5.20), judged on the views and poses of others."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.fitting.refinement import LocatedViews, RefinementSettings, refined
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam_lab.repetitions import repeat
from semantic_slam_lab.studies.ch5.models import trained
from semantic_slam_lab.studies.ch5.tracks import Drive, Located, Smoothed


def refinement_numbers(
    runs: Sequence[Located], new_names: Sequence[str], formulation: str, jobs: int, settings: RefinementSettings
) -> dict[str, float]:
    """Numbers before and after refinement, for trained and new objects; the last track around each object judges."""
    last = max(run.number for run in runs)
    used, judged = [run for run in runs if run.number < last], [run for run in runs if run.number == last]
    model, ends = trained(formulation).model, [run.estimates[formulation] for run in used]
    descriptors = {"before": _descriptors(used, ends)}

    def localise(by: LatentModel) -> LocatedViews:
        nonlocal ends
        if by is not model:
            ends = _solved(by, used, formulation, jobs)
        return _at(used, ends, formulation)

    after = refined(model, localise, settings)
    descriptors["after"] = _descriptors(used, ends)
    estimates = {
        "before": [run.estimates[formulation] for run in judged],
        "after": _solved(after, judged, formulation, jobs),
    }
    numbers = {}
    for when, by in (("before", model), ("after", after)):
        for group, is_new in (("trained", False), ("new", True)):
            rows = [row for row, run in enumerate(judged) if (run.name in new_names) == is_new]
            ratios = [_ratio(judged[row], estimates[when][row]) for row in rows]
            likelihoods = [_log_likelihood(by, judged[row], descriptors[when], formulation) for row in rows]
            numbers[f"{group}_objects_{when}_error_vs_dead_reckoning"] = float(np.median(ratios))
            numbers[f"{group}_objects_{when}_log_likelihood_per_view"] = float(np.mean(likelihoods))
    return numbers


def _solved(model: LatentModel, runs: Sequence[Located], formulation: str, jobs: int) -> list[Smoothed]:
    return repeat(_smoothed, [(run.drives[formulation], model) for run in runs], jobs, "tracks with refined parameters")


def _smoothed(drive: Drive, model: LatentModel) -> Smoothed:
    """The posterior of a track, whose descriptor is unknown."""
    return drive.smoothed(model, model.prior)


def _at(runs: Sequence[Located], ends: Sequence[Smoothed], formulation: str) -> LocatedViews:
    """All views where the posterior has them."""
    drives = [run.drives[formulation] for run in runs]
    seen = [se2.between(end.target, end.poses) for end in ends]
    azimuth = np.concatenate([np.arctan2(poses[:, 1], poses[:, 0]) for poses in seen])
    elevation = np.concatenate([drive.elevation_rad for drive in drives])
    return LocatedViews(
        np.concatenate([drive.features for drive in drives]),
        Viewpoints(azimuth, elevation, np.ones(len(azimuth))),
        np.concatenate([np.tile(end.descriptor, (len(end.poses), 1)) for end in ends]),
    )


def _descriptors(runs: Sequence[Located], ends: Sequence[Smoothed]) -> dict[str, Array]:
    """Descriptor of each object by its name, averaged over its tracks."""
    names = {run.name for run in runs}
    own = {name: [end.descriptor for run, end in zip(runs, ends, strict=True) if run.name == name] for name in names}
    return {name: np.mean(values, axis=0) for name, values in own.items()}


def _ratio(run: Located, end: Smoothed) -> float:
    return float(run.errors_m(end.poses).mean() / run.errors_m(run.dead_reckoning).mean())


def _log_likelihood(model: LatentModel, run: Located, descriptors: dict[str, Array], formulation: str) -> float:
    """Mean over the views at their true directions [nats]; the descriptor is that of the object's other tracks."""
    drive, count = run.drives[formulation], len(run.truth)
    azimuth = np.arctan2(run.truth[:, 1], run.truth[:, 0])
    directions = Viewpoints(azimuth, drive.elevation_rad, np.ones(count))
    prediction = model.predict(directions, np.tile(descriptors[run.name], (count, 1)))
    residual = (drive.features - prediction.mean) / prediction.sigma
    densities = -0.5 * residual**2 - np.log(prediction.sigma) - 0.5 * np.log(2.0 * np.pi)
    return float(densities.sum(axis=1).mean())
