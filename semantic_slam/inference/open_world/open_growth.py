"""Components of an open world grow: together until they settle, or one by one with a single update."""

from collections.abc import Callable, Sequence

from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.smoothing.batch_update import update_all
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.growth import Outcome, alone
from semantic_slam.inference.smoothing.keyframe_factors import KeyframeFactors
from semantic_slam.inference.smoothing.open_component import OpenComponent, OpenUpdate


def settled(
    parents: Sequence[OpenComponent], motion: Motion, added: Sequence[OpenUpdate], max_fresh: int, *, in_place: bool
) -> list[Outcome]:
    """A child of each parent; an error stands for one that is indeterminate.

    Parents stay as they were, unless an only child may use up its parent ``in_place``.
    """
    shared = _shared(parents, motion)
    extensions = [parent.extension_by(shared[parent.noise], own) for parent, own in zip(parents, added, strict=True)]
    smoothers = update_all([parent.smoother for parent in parents], extensions, alone(parents) if in_place else ())
    return [
        smoother if isinstance(smoother, LostComponentError) else _attempt(parent.grown, own, smoother, max_fresh)
        for parent, own, smoother in zip(parents, added, smoothers, strict=True)
    ]


def stepped(
    parents: Sequence[OpenComponent], motion: Motion, added: Sequence[OpenUpdate], max_fresh: int, *, in_place: bool
) -> list[Outcome]:
    """The same after one update each, the next keyframe going on; ``in_place``: a last child uses up its parent."""
    shared = _shared(parents, motion)
    last = {id(parent): place for place, parent in enumerate(parents)} if in_place else {}

    def child(place: int, parent: OpenComponent, own: OpenUpdate) -> OpenComponent:
        smoother = parent.stepped_by(shared[parent.noise], own, in_place=last.get(id(parent)) == place)
        return parent.grown(own, smoother, max_fresh)

    return [_attempt(child, place, *pair) for place, pair in enumerate(zip(parents, added, strict=True))]


def _shared(parents: Sequence[OpenComponent], motion: Motion) -> dict[int, KeyframeFactors]:
    """The factors of the keyframe under each of the noises that odometry may have."""
    by_noise = {parent.noise: parent for parent in parents}
    return {
        noise: KeyframeFactors(own.spaces, own.model, own.keyframe + 1, own.scaled(motion))
        for noise, own in by_noise.items()
    }


def _attempt(grow: Callable[..., OpenComponent], *arguments: object) -> Outcome:
    try:
        return grow(*arguments)
    except LostComponentError as fault:
        return fault
