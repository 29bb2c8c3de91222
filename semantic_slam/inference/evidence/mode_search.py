"""Search for the modes of candidates over their whole windows, with the evidence and moments of each.

Candidates whose windows have the same shape are searched and sampled as one batch, which is faster.
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
    Drawn,
    Gaussians,
    Samples,
    adapted,
    draw,
    effective_share,
    normal_points,
    proposal,
    weighed,
)
from semantic_slam.inference.evidence.laplace import Mode, mode_at
from semantic_slam.inference.evidence.posterior_mode import PosteriorMode, SampledMoments, WindowSamples
from semantic_slam.inference.evidence.window import ModeRegion, Window, window_problem_of
from semantic_slam.inference.evidence.window_problem import WindowProblem
from semantic_slam.inference.states.keys import object_key, robot_key

NUM_STARTS = 8
"""Number of search starts drawn from the prior, besides those at the given estimate."""
NUDGE = 0.3
"""Whitened distance of two starts on either side of the given one, as a search that starts on a saddle stays there."""
SEARCHED_LINKS = 2
"""Largest number of keyframes since the anchor for which the prior is searched; later, modes are already separate."""
START_SPREAD = 0.7
"""Spread of the starts from the prior, in its standard deviations: modes far out have no weight."""
ROUGH, NUDGED, EXACT = 0.01, 1e-3, 1e-6
"""Convergence tolerances of searches, as the largest expected gain of the last step in nats.

Of those from the prior, of those beside the given start, and of the one that is continued in each valley.
"""
ROUNDS = ((5, 6.0), (7, 2.0))
"""Rounds of the rough search: iterations, after which searches in the same valley are merged, and the gate.

Searches that are behind the best by more than the second number times ``NEGLIGIBLE`` are dropped.
"""
SAME_VALLEY = 0.5
"""Distance, in posterior standard deviations, below which two rough modes are refined by one exact search."""
SAME_MODE = 0.05
"""Largest difference of whitened coordinates at which two modes count as the same."""
MAX_MODES = 4
NEGLIGIBLE = 7.0
"""Nats below the best at which a mode is dropped; its region goes to the others."""
POOR = 0.6
"""Effective samples, as a share of the number drawn at a time, below which the proposal is adapted to draw more."""
MAX_ADAPTATIONS = 3
"""Largest number of adaptations of the proposal with the first part of the samples, and with all of them."""
FIRST_SHARE = 0.25
"""Fraction of the samples that is drawn first; all are drawn where these do not suffice."""
FEWEST_FIRST = 2 * (MAX_MODES + 1)
"""Samples that are drawn first at least: a point and its mirror image of each mode and of the prior."""
GOOD = 0.7
"""Effective share above which the first samples suffice: below, a tail may have been missed."""
MOST_TOGETHER = 64
"""Largest number of windows per batch, limited by the memory of their samples."""


@dataclass(frozen=True)
class SearchStart:
    """A window and the given start of its search: (1 + T, s) robot states and (O, s) objects seen since the anchor."""

    window: Window
    robots: Array
    objects: Array


def search_modes(starts: Sequence[SearchStart], settings: WeightsConfiguration) -> list[list[PosteriorMode]]:
    """Modes of each window, best first; empty where no sample has any weight.

    A window of ``max_history`` keyframes ends: its modes become Gaussian hypotheses. Raises LostComponentError.
    """
    groups: dict[object, list[int]] = {}
    for row, start in enumerate(starts):
        groups.setdefault(start.window.shape(), []).append(row)
    modes_of: list[list[PosteriorMode]] = [[] for _ in starts]
    for rows in groups.values():
        for at in range(0, len(rows), MOST_TOGETHER):
            together = rows[at : at + MOST_TOGETHER]
            for row, modes in zip(together, _refined([starts[row] for row in together], settings), strict=True):
                modes_of[row] = modes
    return modes_of


def _refined(starts: Sequence[SearchStart], settings: WeightsConfiguration) -> list[list[PosteriorMode]]:
    """Modes of windows that have one shape, best first."""
    windows = [start.window for start in starts]
    problem = window_problem_of(windows)
    y = problem.coordinates(np.array([s.robots for s in starts]), np.array([s.objects for s in starts]))
    modes = _distinct(windows, problem, *_search(problem, y))
    mixtures, samples = _sampled(windows, problem, modes, settings.importance_samples)
    looks = (
        _Look(
            window=window,
            problem=problem.select(slice(row, row + 1)),
            modes=modes[row],
            states=states,
            mixture=mixtures[row],
            samples=samples[row],
        )
        for row, (window, states) in enumerate(zip(windows, _states(problem, modes), strict=True))
    )
    return [_of_one(look, settings) for look in looks]


def _states(problem: WindowProblem, modes: Sequence[Mode]) -> list[Array]:
    """(M, 1 + T + O, s) robot states, the anchor's first, and objects at the M modes of each window."""
    counts = [len(mode.y) for mode in modes]
    repeated = problem.select(np.repeat(np.arange(len(modes)), counts))
    robots, objects = repeated.states(np.concatenate([mode.y for mode in modes]))
    return np.split(problem.spaces.storage.stacked(robots, objects), np.cumsum(counts)[:-1])


@dataclass(frozen=True, kw_only=True)
class _Look:
    """Search result of one window, with the window problem of that window alone."""

    window: Window
    problem: WindowProblem
    modes: Mode  # M
    states: Array  # (M, 1 + T + O, s)
    mixture: Gaussians
    samples: Samples


def _of_one(look: _Look, settings: WeightsConfiguration) -> list[PosteriorMode]:
    window, samples = look.window, look.samples
    log_evidence, weights = samples.part()
    if not weights.any():
        return []
    kept, region = _kept(look.mixture, samples)
    share = 1.0 / float(weights @ weights) / len(weights)
    gaussian = len(kept) == 1 and not window.regions and share >= settings.gaussian_share * (1.0 - PRIOR_SHARE)
    ends = gaussian or len(window.taken) >= settings.max_history
    drawn = WindowSamples(look.problem, samples.y)
    if len(kept) == 1:
        kept_window = None if ends else replace(window, log_evidence=log_evidence)
        return [_mode(look, drawn, kept[0], weights, log_evidence, kept_window)]
    posterior_modes = []
    for number, (at, log_part) in enumerate(zip(kept, region.log_responsibilities(samples.y), strict=True)):
        log_evidence, weights = samples.part(log_part)
        split = ModeRegion(
            modes=region,
            number=number,
            num_objects=look.problem.mean.shape[1] - 1,
            num_links=len(look.problem.links),
        )
        regions = (*window.regions, split)
        kept_window = None if ends else replace(window, regions=regions, log_evidence=log_evidence)
        posterior_modes.append(_mode(look, drawn, at, weights, log_evidence, kept_window))
    return posterior_modes


def _mode(
    look: _Look, drawn: WindowSamples, at: int, weights: Array, log_evidence: float, kept_window: Window | None
) -> PosteriorMode:
    window, modes = look.window, look.modes
    keyframe = window.anchor.keyframe + len(window.taken)
    keys = [robot_key(keyframe), *(object_key(n) for n in window.object_ids())]
    past = [robot_key(k) for k in range(window.anchor.keyframe, keyframe)]
    return PosteriorMode(
        log_evidence=log_evidence,
        effective_share=1.0 / float(weights @ weights) / len(weights),
        smoothed={
            key: look.problem.spaces.own(key, state) for key, state in zip([*past, *keys], look.states[at], strict=True)
        },
        window=kept_window,
        moments=SampledMoments(drawn=drawn, y=modes.y[at], hessian=modes.hessian[at], weights=weights, keys=keys),
        num_samples=len(weights),
    )


def _sampled(
    windows: Sequence[Window], problem: WindowProblem, modes: Sequence[Mode], count: int
) -> tuple[list[Gaussians], list[Samples]]:
    """Samples and their proposal mixtures: a first part of ``count``, or all where that does not suffice."""
    sampling = _Sampling(windows, problem, [proposal(mode.y, mode.hessian, mode.log_evidence) for mode in modes])
    first = max(int(np.ceil(FIRST_SHARE * count)), FEWEST_FIRST)
    samples, shares = sampling.adapting(np.arange(len(windows)), first)
    coarse = np.flatnonzero((shares < GOOD) & (first < count))
    if len(coarse):
        more, _ = sampling.adapting(coarse, count)
        for row, better in zip(coarse, more, strict=True):
            samples[row] = better
    return sampling.mixtures, samples


class _Sampling:
    """Sampling of K windows from proposal mixtures, which are adapted in place where they fit their targets poorly."""

    def __init__(self, windows: Sequence[Window], problem: WindowProblem, mixtures: list[Gaussians]):
        self._windows, self._problem, self.mixtures = windows, problem, mixtures
        self._fitted = [0] * len(windows)  # number of quasi-random points that each mixture was fitted to

    def adapting(self, rows: Index, count: int) -> tuple[list[Samples], Array]:
        """Samples of windows ``rows``, weighed with the regions of their modes, and their effective shares.

        ``count`` are drawn, and as many anew after each adaptation; all of these together are weighed.
        """
        sets: dict[int, list[Drawn]] = {row: [] for row in rows.tolist()}
        samples, shares, pending = dict[int, Samples](), np.zeros(len(self._windows)), rows
        for number in range(1 + MAX_ADAPTATIONS):
            for row in pending.tolist() if number else []:
                self.mixtures[row] = adapted(self.mixtures[row], samples[row])
                self._fitted[row] += count // 2
            for row, own in zip(pending.tolist(), self._drawn(pending, count), strict=True):
                sets[row].append(own)
                samples[row] = weighed(sets[row])
                shares[row] = effective_share(samples[row].log_weights)
            pending = pending[(shares[pending] > 0.0) & ((1 + number) * shares[pending] < POOR)]
            if not len(pending):
                break
        return [samples[row] for row in rows.tolist()], shares[rows]

    def _drawn(self, rows: Index, count: int) -> list[Drawn]:
        some = rows.tolist()
        mixtures, fitted = [self.mixtures[row] for row in some], [self._fitted[row] for row in some]
        drawn = draw(self._problem.select(rows), mixtures, count, fitted)
        return [
            replace(own, log_joint=own.log_joint + self._windows[row].log_share(self._problem, own.y))
            for row, own in zip(some, drawn, strict=True)
        ]


def _search(problem: WindowProblem, start: Array) -> tuple[Mode, Index]:
    """Modes found from ``start`` (K, size) and, for short windows, from the prior; and the window that owns each.

    Searches that are far behind are dropped, and those in the same valley are merged.
    """
    aside = NUDGE * normal_points(1, problem.size)
    starts = [start + aside, start - aside]
    if len(problem.links) <= SEARCHED_LINKS:
        starts += [broadcast_copy(y, start.shape) for y in START_SPREAD * normal_points(NUM_STARTS, problem.size)]
    owners = np.repeat(np.arange(len(problem)), len(starts))
    enough = np.tile([NUDGED] * 2 + [ROUGH] * (len(starts) - 2), len(problem))
    search = LevenbergMarquardt(problem.select(owners), np.stack(starts, axis=1).reshape(-1, problem.size))
    for iterations, patience in ROUNDS:
        search.advance(iterations, enough)
        rows = valleys(mode_at(search.reached()), owners, patience * NEGLIGIBLE)
        search, owners, enough = search.select(rows), owners[rows], enough[rows]
    return mode_at(search.finished(tolerance=EXACT)), owners


def valleys(rough: Mode, owners: Index, gate: float) -> Index:
    """The best mode in each valley of each window, those more than ``gate`` nats behind its best left out.

    Ordered by ascending ``owners`` (B,), best first. A valley holds what is close to its best mode, in its metric.
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
    """(B,) index at which the group of each entry begins, in ascending ``groups`` (B,)."""
    return np.asarray(np.searchsorted(groups, groups))


def _close(candidates: Mode, leaders: Index, rows: Index) -> NDArray[np.bool_]:
    """(B,) whether ``rows`` of candidates are close to their ``leaders``, in the metric of the leaders' Hessians.

    That metric is never shorter than that of the prior.
    """
    away = candidates.y[rows] - candidates.y[leaders]
    close = squared_norms(away) <= SAME_VALLEY**2
    near = np.flatnonzero(close)
    squared = (away[near, None] @ candidates.hessian[leaders[near]] @ away[near, :, None])[:, 0, 0]
    close[near] = squared <= SAME_VALLEY**2
    return close


def _distinct(windows: Sequence[Window], problem: WindowProblem, candidates: Mode, owners: Index) -> list[Mode]:
    """The distinct modes of each window that have weight in its region, heaviest first."""
    scores = candidates.log_evidence + problem.select(owners).log_visibility(candidates.y, soft=True)
    modes = []
    for number, window in enumerate(windows):
        rows = np.arange(*np.searchsorted(owners, [number, number + 1]))
        if len(rows) == 1:
            modes.append(candidates.take(rows))
            continue
        log_shares = scores[rows] + window.log_share(problem, candidates.y[rows])
        order = rows[np.argsort(-log_shares, kind="stable")]
        kept: list[int] = []
        for row in order[np.sort(-log_shares) <= NEGLIGIBLE - log_shares.max()]:
            if all(np.abs(candidates.y[row] - candidates.y[other]).max() > SAME_MODE for other in kept):
                kept.append(int(row))
        modes.append(candidates.take(np.array(kept[:MAX_MODES])))
    return modes


def _kept(mixture: Gaussians, samples: Samples) -> tuple[list[int], Gaussians]:
    """Rows of the modes with weight, and the mixture of those alone."""
    alone = mixture.without_prior()
    if len(alone.means) == 1:
        return [0], alone
    evidence = np.array([samples.part(part)[0] for part in alone.log_responsibilities(samples.y)])
    kept = [int(row) for row in np.argsort(-evidence, kind="stable") if evidence[row] >= evidence.max() - NEGLIGIBLE]
    return kept, Gaussians(alone.means[kept], alone.roots[kept], alone.log_shares[kept])
