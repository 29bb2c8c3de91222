"""The shipped models of chapter 5, and the objects that their training saw or set aside."""

from collections.abc import Sequence
from dataclasses import dataclass

from semantic_slam.latent.extractor import FeatureExtractor
from semantic_slam.latent.extractor_store import read_extractor
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.store import read_latent_model
from semantic_slam.perception.networks.weight_files import shipped_file
from semantic_slam_lab.simulation.goods import CLASSES, goods_names

FORMULATIONS = ("map", "energy")
"""Joint posterior maximisation (Sec. 5.A) and energy minimisation (Sec. 5.E), on crops like BigBIRD's."""
DEFAULT = "default"
"""The model of ``map`` again, on a detector's crops in rooms, for which it is shipped."""
WORDS = {
    "map": "joint posterior maximisation",
    "energy": "energy minimisation",
    "default": "the shipped default in rooms",
}
NUM_GOODS = 48
"""Instances that all of them were trained on, those held out included."""


FILES = {
    "map": "latent_model.safetensors",
    "energy": "latent_energy.safetensors",
    "default": "latent_model.safetensors",
}


@dataclass(frozen=True)
class Shipped:
    """A model with the noise of the crops that it is judged on, and the extractor of its features."""

    model: LatentModel
    extractor: FeatureExtractor
    crops: str  # plain, as BigBIRD's masks cut them out, or room
    held_out: tuple[str, ...]  # instances that training set aside


def trained(name: str) -> Shipped:
    """A shipped model by its name in ``WORDS``."""
    file = shipped_file(FILES[name])
    model, crops = read_latent_model(file), "room" if name == DEFAULT else "plain"
    held_out = tuple(str(own) for own in model.provenance.get("held_out", ()))  # type: ignore[attr-defined]
    return Shipped(for_crops(model, crops), read_extractor(file), crops, held_out)


def for_crops(model: LatentModel, crops: str) -> LatentModel:
    """The model with the noise of such crops."""
    return model.on_turntable() if crops == "plain" else model


def chosen_goods(quick_count: int | None) -> tuple[str, ...]:
    """All goods, or some of every class."""
    names = goods_names(NUM_GOODS)
    if quick_count is None:
        return names
    rounds = -(-quick_count // len(CLASSES))
    return names[-rounds * len(CLASSES) :]


def known(model: Shipped, names: Sequence[str]) -> tuple[str, ...]:
    """Names among ``names`` that the model was trained on."""
    return tuple(name for name in names if name in model.model.instances.names)


def new(model: Shipped, names: Sequence[str]) -> tuple[str, ...]:
    """Names among ``names`` that the model's training held out."""
    return tuple(name for name in names if name in model.held_out)
