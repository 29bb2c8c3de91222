"""The modes of one continuation over its whole history, each with its evidence and its moments."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from semantic_slam.configuration import WeightsConfiguration
from semantic_slam.inference.chain import Chain
from semantic_slam.inference.component import object_key, robot_key
from semantic_slam.inference.history import History, Region
from semantic_slam.inference.importance import (
    PRIOR_SHARE,
    Gaussians,
    Samples,
    adapted,
    draw,
    effective_share,
    normal_points,
    proposal,
)
from semantic_slam.inference.laplace import RANKING_ITERATIONS, Mode, find_modes
from semantic_slam.inference.object_views import Correction

Array = NDArray[np.float64]

NUM_STARTS = 8
"""Searches from the prior, besides those from where the hypothesis was."""
NUDGE = 0.3
"""Whitened distance from the given start on either side: on a saddle between two modes, a search would stay."""
SEARCHED_LINKS = 2
"""Keyframes since the anchor up to which the prior is searched: later on, modes have been told apart."""
START_SPREAD = 0.7
"""Standard deviations of the starts: modes far out have no weight."""
SAME_MODE = 0.05
"""Largest difference of whitened coordinates of one mode found twice."""
MAX_MODES = 4
NEGLIGIBLE = 7.0
"""Nats below the best at which a mode is left out; its region goes to the others."""
POOR = 0.6
"""Effective share of samples below which the proposal is adapted to them."""
MAX_ADAPTATIONS = 3


@dataclass(frozen=True)
class Refined:
    """One mode of a continuation."""

    log_evidence: float  # of everything since the anchor, in this mode's region
    effective_share: float  # effective sample size over the number of samples
    smoothed: dict[int, Array]  # GTSAM key -> (d,) mode: robot since the anchor, objects seen since
    corrections: dict[int, Correction]  # GTSAM key -> what the samples say of the Gaussian at the mode
    history: History | None  # None where the mode is Gaussian


def refine(history: History, robots: Array, objects: Array, settings: WeightsConfiguration) -> list[Refined]:
    """Modes of ``history``, best first; empty where no sample is compatible with it.

    ``robots`` (1 + T, d) and ``objects`` (O, d), in the order of the history's objects, are where the first search
    starts. A history of ``max_history`` keyframes is not kept. Raises LostComponentError.
    """
    chain = history.chain()
    modes = _distinct(history, chain, _search(chain, chain.coordinates(robots, objects)))
    mixture, samples = _sampled(history, chain, modes, settings.importance_samples)
    shares = history.log_share(chain, samples.y)
    total = effective_share(samples.log_weights + shares)
    if total == 0.0:
        return []
    kept, region = _kept(mixture, samples, shares)
    parts = region.log_responsibilities(samples.y) + shares
    gaussian = len(kept) == 1 and not history.regions and total >= settings.gaussian_share * (1.0 - PRIOR_SHARE)
    ends = gaussian or len(history.taken) >= settings.max_history
    found = []
    for number, at in enumerate(kept):
        log_evidence = samples.log_evidence(parts[number])
        weights = samples.normalised(parts[number])
        mode = Mode(modes.y[at], modes.hessian[at], modes.log_evidence[at])
        own = history.regions
        if len(kept) > 1:
            own = (*own, Region(region, number, len(chain.mean) - 1, len(chain.links)))
        kept_history = None if ends else replace(history, regions=own, log_evidence=log_evidence)
        found.append(_refined(history, chain, mode, samples, weights, log_evidence, kept_history))
    return found


def _sampled(history: History, chain: Chain, modes: Mode, count: int) -> tuple[Gaussians, Samples]:
    """Samples and the mixture they are from, adapted where the Laplace modes do not match the target."""
    mixture = proposal(modes.y, modes.hessian, modes.log_evidence)
    samples = draw(chain, mixture, count)
    for _ in range(MAX_ADAPTATIONS):
        shares = history.log_share(chain, samples.y)
        if not 0.0 < effective_share(samples.log_weights + shares) < POOR:
            break
        mixture = adapted(mixture, samples, shares)
        samples = draw(chain, mixture, count)
    return mixture, samples


def _search(chain: Chain, start: Array) -> Mode:
    """Modes from ``start`` and, while the history is short, from the prior; what is far behind is not followed."""
    aside = NUDGE * normal_points(1, chain.size)
    starts = [start + aside, start - aside]
    if len(chain.links) <= SEARCHED_LINKS:
        starts.append(START_SPREAD * normal_points(NUM_STARTS, chain.size))
    rough = find_modes(chain, np.concatenate(starts), RANKING_ITERATIONS)
    near = rough.log_evidence >= rough.log_evidence.max() - 2.0 * NEGLIGIBLE
    return find_modes(chain, rough.y[near])


def _distinct(history: History, chain: Chain, modes: Mode) -> Mode:
    """Modes that differ and have weight in the history's region, heaviest first."""
    scores = modes.log_evidence + history.log_share(chain, modes.y) + chain.log_visibility(modes.y, soft=True)
    kept: list[int] = []
    for row in np.argsort(-scores, kind="stable"):
        if len(kept) == MAX_MODES or (kept and scores[row] < scores[kept[0]] - NEGLIGIBLE):
            break
        if all(np.abs(modes.y[row] - modes.y[other]).max() > SAME_MODE for other in kept):
            kept.append(int(row))
    return Mode(modes.y[kept], modes.hessian[kept], modes.log_evidence[kept])


def _kept(mixture: Gaussians, samples: Samples, shares: Array) -> tuple[list[int], Gaussians]:
    """Rows of the modes with weight, and the mixture of those alone."""
    alone = mixture.without_prior()
    parts = alone.log_responsibilities(samples.y) + shares
    evidence = np.array([samples.log_evidence(part) for part in parts])
    kept = [int(row) for row in np.argsort(-evidence, kind="stable") if evidence[row] >= evidence.max() - NEGLIGIBLE]
    return kept, Gaussians(alone.means[kept], alone.roots[kept], alone.log_shares[kept])


def _refined(
    history: History,
    chain: Chain,
    mode: Mode,
    samples: Samples,
    weights: Array,
    log_evidence: float,
    kept_history: History | None,
) -> Refined:
    robots, objects = chain.states(mode.y[None])
    keyframe = history.anchor.keyframe + len(history.taken)
    object_ids = history.object_ids()
    keys = [robot_key(keyframe), *(object_key(n) for n in object_ids)]
    past = [robot_key(k) for k in range(history.anchor.keyframe, keyframe)]
    return Refined(
        log_evidence,
        float(1.0 / (weights**2).sum() / len(weights)),
        dict(zip([*past, *keys], [*robots[0], *objects[0]], strict=True)),
        _corrections(chain, mode, samples, weights, keys),
        kept_history,
    )


def _corrections(chain: Chain, mode: Mode, samples: Samples, weights: Array, keys: list[int]) -> dict[int, Correction]:
    """Weighted moments of the newest robot state and of the objects, against the Laplace Gaussian's."""
    slopes = chain.newest_slopes(mode.y)
    spread = cho_solve((np.linalg.cholesky(mode.hessian), True), slopes.reshape(-1, chain.size).T)
    count, dimension = len(keys), chain.dimension
    robots, objects = chain.states(np.concatenate([mode.y[None], samples.y]))
    states = np.concatenate([robots[:, -1:], objects], axis=1)
    found = {}
    for row, key in enumerate(keys):
        own = spread.reshape(chain.size, count, dimension)[:, row]
        covariance = slopes[row] @ own
        found[key] = Correction.towards(chain.manifold, states[0, row], covariance, states[1:, row], weights)
    return found
