"""The shipped models of chapter 5, and the objects that their training saw or set aside."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.latent.store import TrainedModel, read_trained, shipped_model
from semantic_slam.simulation.goods import CLASSES, goods_names

FORMULATIONS = ("map", "energy")
"""Joint posterior maximisation (Sec. 5.A) and energy minimisation (Sec. 5.E), on crops like BigBIRD's."""
DEFAULT = "default"
"""The shipped one: joint posterior maximisation on a detector's crops in rooms."""
WORDS = {
    "map": "joint posterior maximisation",
    "energy": "energy minimisation",
    "default": "the shipped default",
}
NUM_GOODS = 48
"""Instances that all of them were trained on, those held out included."""


def trained(name: str) -> TrainedModel:
    """A shipped model by its name in ``WORDS``."""
    return read_trained(shipped_model(name))


def chosen_goods(quick_count: int | None) -> tuple[str, ...]:
    """All goods, or some of every class."""
    names = goods_names(NUM_GOODS)
    if quick_count is None:
        return names
    rounds = -(-quick_count // len(CLASSES))
    return names[-rounds * len(CLASSES) :]


def known(model: TrainedModel, names: Sequence[str]) -> tuple[str, ...]:
    """Those of ``names`` that the model was trained on."""
    return tuple(name for name in names if name in model.model.instances.names)


def new(model: TrainedModel, names: Sequence[str]) -> tuple[str, ...]:
    """Those of ``names`` that its training held out."""
    return tuple(name for name in names if name in model.held_out)


def descriptor_of(model: TrainedModel, name: str) -> np.ndarray:
    """(L,) as learned; raises ValueError for an instance that was not trained on."""
    return np.asarray(model.model.instances.descriptors[model.model.instances.names.index(name)])
