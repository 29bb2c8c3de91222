"""Parameters that somebody has set and nobody reads: others stand in their place."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any, NamedTuple

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import Configuration, OpenWorldConfiguration
from semantic_slam.inference.association.strategy import strategy_of

REPLACED = {
    "detection_probability": "detection_probabilities",
    "miss_persistence": "miss_persistences",
    "clutter_per_frame": "clutters_per_frame",
    "birth_density": "birth_densities",
}
"""Rate of ``open_world`` -> the list of its values that takes its place where it is not empty."""


class Idle(NamedTuple):
    """A parameter without effect: which and why, and what to set in its place."""

    what: str
    remedy: str

    @property
    def line(self) -> str:
        return f"{self.what}; {self.remedy}"


def idle_parameters(configuration: Configuration) -> Iterator[Idle]:
    """Parameters that differ from their defaults, and change nothing in a run with this configuration.

    Where misses do not count, as with given identities, nothing is said of rates and of the sensor's region: most of
    ``open_world`` is without effect there.
    """
    if strategy_of(configuration).counts_misses:
        yield from _rates(configuration.open_world)
        if not configuration.is_spatial:
            yield from _region(configuration)
    model = configuration.semantic_model
    if _is_set(model, "likelihood_tempering") and not class_model_kind(model).repeats_errors:
        what = f"semantic_model.likelihood_tempering has no effect with kind: {model.kind}"
        instead = "set label_accuracy or repeat_shares" if model.kind == "detector" else "remove it"
        yield Idle(what, instead)


def _rates(world: OpenWorldConfiguration) -> Iterator[Idle]:
    for one, several in REPLACED.items():
        if getattr(world, several) and _is_set(world, one):
            what = f"open_world.{one} has no effect beside {several}, which takes its place"
            yield Idle(what, f"set the values of open_world.{several}, or [] for this one alone")


def _region(configuration: Configuration) -> Iterator[Idle]:
    """What a learned region takes the place of; its direction may still be the axis along which depths are measured."""
    world, ranges_are = configuration.open_world, configuration.perception.ranges_are
    if not world.learn_region:
        if _is_set(world, "learn_region_within_m"):
            yield Idle("open_world.learn_region_within_m has no effect with learn_region: false", "set max_range_m")
        return
    for name in ("field_of_view_rad", "direction_rad"):
        is_axis = name == "direction_rad" and tuple(ranges_are) != ("distance",)
        if _is_set(world, name) and not is_axis:
            what = f"open_world.{name} has no effect with learn_region: true"
            yield Idle(what, "set learn_region: false to state it")


def _is_set(settings: Any, name: str) -> bool:
    """Whether a parameter of a section differs from its default."""
    default = next(own.default for own in fields(settings) if own.name == name)
    return bool(getattr(settings, name) != default)
