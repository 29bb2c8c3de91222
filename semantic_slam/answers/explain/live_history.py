"""What one hypothesis knows after a keyframe, and what it did in it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.inference.smoothing.component import Component


@dataclass(frozen=True, kw_only=True)
class ObjectOfHistory:
    """What one hypothesis knows of the class of one object; C classes."""

    log_class: Array  # (C,) log probabilities
    log_likelihood: Array | None  # (C,) of its views from where this hypothesis has them; None: it has none on record
    newest: Array | None  # (C,) of the newest of them given the others, where that is not what it added
    log_ratios: Array | None  # (C,) in log_likelihood: how its class's prior differed when it was added; None: never


@dataclass(frozen=True, kw_only=True)
class LiveHistory:
    """A hypothesis after a keyframe."""

    parent_id: int  # of the keyframe before, as beliefs tell it
    log_weight: float
    history: int  # equal for hypotheses with the same associations since the start, whatever their classes and modes
    association: tuple[int, ...]  # (D,) object ids in this keyframe, -1 clutter
    is_revised: bool  # its history was not its parent's
    changes: tuple[tuple[int, int, int], ...]  # keyframe, detection, object or -1: where it differs from its parent's
    pose: Array  # (7,) robot in map
    objects: Mapping[int, ObjectOfHistory]


def object_of(component: Component, names: Sequence[int], log_prior: Array) -> ObjectOfHistory:
    """What a component knows of an object that it may have under some numbers, with the (C,) prior of its class."""
    record = next((component.views[n] for n in names if n in component.views), None)
    known = record is not None and len(record.log_likelihood) == len(log_prior)
    likelihood = record.log_likelihood if record is not None and known else None
    enumerated = next((component.classes[n] for n in names if n in component.classes), None)
    if enumerated is not None:
        log_class = np.where(np.arange(len(log_prior)) == enumerated, 0.0, -np.inf)
    else:
        joint = log_prior if likelihood is None else log_prior + likelihood
        log_class = joint - log_sum_exp(joint) if len(joint) else joint
    newest = record.newest if record is not None and known else None
    ratios = record.log_ratios if record is not None and known else None
    return ObjectOfHistory(log_class=log_class, log_likelihood=likelihood, newest=newest, log_ratios=ratios)
