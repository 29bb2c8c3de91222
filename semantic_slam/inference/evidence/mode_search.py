"""The modes of continuations over their whole history, each with its evidence and its moments.

Continuations of one shape are searched and sampled together: what they need is many small numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import WeightsConfiguration
from semantic_slam.geometry.arrays import Array, Index, broadcast_copy, squared_norms
from semantic_slam.geometry.levenberg_marquardt import LevenbergMarquardt
from semantic_slam.inference.evidence.importance import (
    PRIOR_SHARE,
    Gaussians,
    Samples,
    adapted,
    draw,
    effective_share,
    normal_points,
    proposal,
)
from semantic_slam.inference.evidence.laplace import Mode, mode_at
from semantic_slam.inference.evidence.posterior_mode import PosteriorMode, SampledMoments, WindowSamples
from semantic_slam.inference.evidence.window import Region, Window, window_problem_of
from semantic_slam.inference.evidence.window_problem import WindowProblem
from semantic_slam.inference.states.keys import object_key, robot_key

NUM_STARTS = 8
"""Searches from the prior, besides those from where the hypothesis was."""
NUDGE = 0.3
"""Whitened distance from the given start on either side: on a saddle between two modes, a search would stay."""
SEARCHED_LINKS = 2
"""Keyframes since the anchor up to which the prior is searched: later on, modes have been told apart."""
START_SPREAD = 0.7
"""Standard deviations of the starts: modes far out have no weight."""
ROUGH, NUDGED, EXACT = 0.01, 1e-3, 1e-6
"""Nats that the last step of a search may have been expected to bring: from the prior, from beside the given start,
and of the one that goes on in each valley."""
ROUNDS = ((5, 6.0), (7, 2.0))
"""Iterations of the rough searches after which those in one valley go on as one, and how far behind others are left:
so many times what is negligible."""
SAME_VALLEY = 0.5
"""Posterior standard deviations between two rough modes that one exact search serves."""
SAME_MODE = 0.05
"""Largest difference of whitened coordinates of one mode found twice."""
MAX_MODES = 4
NEGLIGIBLE = 7.0
"""Nats below the best at which a mode is left out; its region goes to the others."""
POOR = 0.6
"""Effective share of samples below which the proposal is adapted to them."""
MAX_ADAPTATIONS, MORE_ADAPTATIONS = 3, 1
"""Of the first samples, and of all."""
FIRST_SHARE = 0.25
"""Of the samples: so many are drawn at first, all of them where those do not suffice."""
GOOD = 0.7
"""Effective share of the first samples from which on they suffice: below, a tail may have been missed."""
MOST_TOGETHER = 64
"""Histories looked at together, for the memory that their samples take."""


@dataclass(frozen=True)
class SearchStart:
    """A history and where the first search for its modes starts: (1 + T, s) robot and (O, s) objects seen since."""

    history: Window
    robots: Array
    objects: Array


def search_one(history: Window, robots: Array, objects: Array, settings: WeightsConfiguration) -> list[PosteriorMode]:
    """Modes of ``history``, best first; see :func:`search_modes`."""
    return search_modes([SearchStart(history, robots, objects)], settings)[0]


def search_modes(starts: Sequence[SearchStart], settings: WeightsConfiguration) -> list[list[PosteriorMode]]:
    """Modes of each history, best first; empty where no sample is compatible with it.

    A history of ``max_history`` keyframes is not kept. Raises LostComponentError.
    """
    groups: dict[object, list[int]] = {}
    for row, start in enumerate(starts):
        groups.setdefault(start.history.shape(), []).append(row)
    found: list[list[PosteriorMode]] = [[] for _ in starts]
    for rows in groups.values():
        for at in range(0, len(rows), MOST_TOGETHER):
            together = rows[at : at + MOST_TOGETHER]
            for row, modes in zip(together, _refined([starts[row] for row in together], settings), strict=True):
                found[row] = modes
    return found


def _refined(starts: Sequence[SearchStart], settings: WeightsConfiguration) -> list[list[PosteriorMode]]:
    """Of histories of one shape."""
    histories = [start.history for start in starts]
    chain = window_problem_of(histories)
    y = chain.coordinates(np.array([s.robots for s in starts]), np.array([s.objects for s in starts]))
    modes = _distinct(histories, chain, *_search(chain, y))
    mixtures, samples = _sampled(histories, chain, modes, settings.importance_samples)
    looks = (
        _Look(history, chain.select(slice(row, row + 1)), modes[row], states, mixtures[row], samples[row])
        for row, (history, states) in enumerate(zip(histories, _states(chain, modes), strict=True))
    )
    return [_of_one(look, settings) for look in looks]


def _states(chain: WindowProblem, modes: Sequence[Mode]) -> list[Array]:
    """(M, 1 + T + O, s) robot states, the anchor's first, and objects at the M modes of each history."""
    counts = [len(own.y) for own in modes]
    repeated = chain.select(np.repeat(np.arange(len(modes)), counts))
    robots, objects = repeated.states(np.concatenate([own.y for own in modes]))
    return np.split(chain.spaces.storage.stacked(robots, objects), np.cumsum(counts)[:-1])


@dataclass(frozen=True)
class _Look:
    """What was found of one history, whose chain it is alone in."""

    history: Window
    chain: WindowProblem
    modes: Mode  # M
    states: Array  # (M, 1 + T + O, s)
    mixture: Gaussians
    samples: Samples


def _of_one(look: _Look, settings: WeightsConfiguration) -> list[PosteriorMode]:
    history, samples = look.history, look.samples
    log_evidence, weights = samples.part()
    if not weights.any():
        return []
    kept, region = _kept(look.mixture, samples)
    share = 1.0 / float(weights @ weights) / len(weights)
    gaussian = len(kept) == 1 and not history.regions and share >= settings.gaussian_share * (1.0 - PRIOR_SHARE)
    ends = gaussian or len(history.taken) >= settings.max_history
    drawn = WindowSamples(look.chain, samples.y)
    if len(kept) == 1:
        kept_history = None if ends else replace(history, log_evidence=log_evidence)
        return [_mode(look, drawn, kept[0], weights, log_evidence, kept_history)]
    found = []
    for number, (at, log_part) in enumerate(zip(kept, region.log_responsibilities(samples.y), strict=True)):
        log_evidence, weights = samples.part(log_part)
        own = (*history.regions, Region(region, number, look.chain.mean.shape[1] - 1, len(look.chain.links)))
        kept_history = None if ends else replace(history, regions=own, log_evidence=log_evidence)
        found.append(_mode(look, drawn, at, weights, log_evidence, kept_history))
    return found


def _mode(
    look: _Look, drawn: WindowSamples, at: int, weights: Array, log_evidence: float, kept_history: Window | None
) -> PosteriorMode:
    history, modes = look.history, look.modes
    keyframe = history.anchor.keyframe + len(history.taken)
    keys = [robot_key(keyframe), *(object_key(n) for n in history.object_ids())]
    past = [robot_key(k) for k in range(history.anchor.keyframe, keyframe)]
    return PosteriorMode(
        log_evidence,
        1.0 / float(weights @ weights) / len(weights),
        {key: look.chain.spaces.own(key, state) for key, state in zip([*past, *keys], look.states[at], strict=True)},
        kept_history,
        SampledMoments(drawn, modes.y[at], modes.hessian[at], weights, keys),
        len(weights),
    )


def _sampled(
    histories: Sequence[Window], chain: WindowProblem, modes: Sequence[Mode], count: int
) -> tuple[list[Gaussians], list[Samples]]:
    """Samples and the mixtures they are from: a first part of ``count``, all where that shows not to suffice."""
    mixtures = [proposal(mode.y, mode.hessian, mode.log_evidence) for mode in modes]
    first = int(np.ceil(FIRST_SHARE * count))
    everything = np.arange(len(histories))
    samples, shares = _adapting(histories, chain, mixtures, everything, first, MAX_ADAPTATIONS)
    coarse = np.flatnonzero((shares < GOOD) & (first < count))
    if len(coarse):
        more, _ = _adapting(histories, chain, mixtures, coarse, count, MORE_ADAPTATIONS)
        for row, better in zip(coarse, more, strict=True):
            samples[row] = better
    return mixtures, samples


def _adapting(
    histories: Sequence[Window], chain: WindowProblem, mixtures: list[Gaussians], rows: Index, count: int, times: int
) -> tuple[list[Samples], Array]:
    """Samples of ``rows``, weighed in the regions that these answer for, and their effective shares.

    Mixtures are adapted in place where modes miss the target.
    """
    samples, shares, pending = dict[int, Samples](), np.zeros(len(histories)), rows
    for left in reversed(range(times + 1)):
        for row, drawn in zip(pending, draw(chain.select(pending), [mixtures[r] for r in pending], count), strict=True):
            samples[row] = Samples(drawn.y, drawn.log_weights + histories[row].log_share(chain, drawn.y))
        shares[pending] = effective_share(np.array([samples[row].log_weights for row in pending]))
        pending = pending[(shares[pending] > 0.0) & (shares[pending] < POOR)]
        if not left or not len(pending):
            break
        for row in pending:
            mixtures[row] = adapted(mixtures[row], samples[row])
    return [samples[row] for row in rows], shares[rows]


def _search(chain: WindowProblem, start: Array) -> tuple[Mode, Index]:
    """Modes from ``start`` (K, size) and, while histories are short, from the prior; and whose each is.

    What is far behind is not followed, and searches that end in one valley go on as one.
    """
    aside = NUDGE * normal_points(1, chain.size)
    starts = [start + aside, start - aside]
    if len(chain.links) <= SEARCHED_LINKS:
        starts += [broadcast_copy(y, start.shape) for y in START_SPREAD * normal_points(NUM_STARTS, chain.size)]
    owners = np.repeat(np.arange(len(chain)), len(starts))
    enough = np.tile([NUDGED] * 2 + [ROUGH] * (len(starts) - 2), len(chain))
    search = LevenbergMarquardt(chain.select(owners), np.stack(starts, axis=1).reshape(-1, chain.size))
    for iterations, patience in ROUNDS:
        search.advance(iterations, enough)
        rows = valleys(mode_at(search.reached()), owners, patience * NEGLIGIBLE)
        search, owners, enough = search.select(rows), owners[rows], enough[rows]
    return mode_at(search.finished(tolerance=EXACT)), owners


def valleys(rough: Mode, owners: Index, gate: float) -> Index:
    """The best mode in each valley of each history, those more than ``gate`` nats behind its best left out.

    By ascending ``owners`` (B,), best first. In a valley is what is close to its best in that one's own metric.
    """
    order = np.lexsort((-rough.log_evidence, owners))
    best = _leaders(owners[order])
    order = order[rough.log_evidence[order] >= rough.log_evidence[order[best]] - gate]
    kept, place = np.zeros(len(owners), dtype=bool), order
    while len(place):
        leaders = place[_leaders(owners[place])]
        kept[leaders] = True
        place = place[~_close(rough, leaders, place) & (place != leaders)]
    return order[kept[order]]


def _leaders(groups: Index) -> Index:
    """(B,) where each one's group of (B,) ascending ``groups`` begins."""
    return np.asarray(np.searchsorted(groups, groups))


def _close(found: Mode, leaders: Index, rows: Index) -> NDArray[np.bool_]:
    """(B,) whether some of ``found`` are close to others, in the metric of those: never shorter than the prior's."""
    away = found.y[rows] - found.y[leaders]
    close = squared_norms(away) <= SAME_VALLEY**2
    near = np.flatnonzero(close)
    squared = (away[near, None] @ found.hessian[leaders[near]] @ away[near, :, None])[:, 0, 0]
    close[near] = squared <= SAME_VALLEY**2
    return close


def _distinct(histories: Sequence[Window], chain: WindowProblem, found: Mode, owners: Index) -> list[Mode]:
    """For each history the modes that differ and have weight in its region, heaviest first."""
    scores = found.log_evidence + chain.select(owners).log_visibility(found.y, soft=True)
    modes = []
    for number, history in enumerate(histories):
        rows = np.arange(*np.searchsorted(owners, [number, number + 1]))
        if len(rows) == 1:
            modes.append(found.take(rows))
            continue
        own = scores[rows] + history.log_share(chain, found.y[rows])
        order = rows[np.argsort(-own, kind="stable")]
        kept: list[int] = []
        for row in order[np.sort(-own) <= NEGLIGIBLE - own.max()]:
            if all(np.abs(found.y[row] - found.y[other]).max() > SAME_MODE for other in kept):
                kept.append(int(row))
        modes.append(found.take(np.array(kept[:MAX_MODES])))
    return modes


def _kept(mixture: Gaussians, samples: Samples) -> tuple[list[int], Gaussians]:
    """Rows of the modes with weight, and the mixture of those alone."""
    alone = mixture.without_prior()
    if len(alone.means) == 1:
        return [0], alone
    evidence = np.array([samples.part(part)[0] for part in alone.log_responsibilities(samples.y)])
    kept = [int(row) for row in np.argsort(-evidence, kind="stable") if evidence[row] >= evidence.max() - NEGLIGIBLE]
    return kept, Gaussians(alone.means[kept], alone.roots[kept], alone.log_shares[kept])
