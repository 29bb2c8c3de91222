"""State of one hypothesis after a keyframe, and its association in it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.inference.smoothing.component import Component


@dataclass(frozen=True, kw_only=True)
class ObjectOfHistory:
    """Class knowledge of one hypothesis about one object; C classes."""

    log_class: Array  # (C,) log probabilities
    log_likelihood: Array | None  # (C,) of its views at this hypothesis's poses; None: no record
    newest: Array | None  # (C,) of the newest view given the others, where that differs from its increment
    log_ratios: Array | None  # (C,) part of log_likelihood: prior log ratios when the object was added; None: none


@dataclass(frozen=True, kw_only=True)
class LiveHistory:
    """A hypothesis after a keyframe."""

    parent_id: int  # parent hypothesis in the previous keyframe, as in beliefs
    log_weight: float
    history: int  # equal for hypotheses with equal associations since the start
    association: tuple[int, ...]  # (D,) object ids in this keyframe, -1 clutter
    is_revised: bool  # its history differs from its parent's
    changes: tuple[tuple[int, int, int], ...]  # keyframe, detection, object or -1: differences to the parent
    pose: Array  # (7,) robot pose in the map frame
    objects: Mapping[int, ObjectOfHistory]


def object_of(component: Component, names: Sequence[int], log_prior: Array) -> ObjectOfHistory:
    """Class knowledge of a component about an object, listed under any of ``names``; ``log_prior`` (C,)."""
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
