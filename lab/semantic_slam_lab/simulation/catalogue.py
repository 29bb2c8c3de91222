"""Everything that can be rendered, by name: furniture and goods, and the pictures on them."""

from semantic_slam_lab.simulation.furniture import MODELS
from semantic_slam_lab.simulation.goods import Model, goods_class, goods_model
from semantic_slam_lab.simulation.goods_pictures import goods_picture
from semantic_slam_lab.simulation.textures import Picture, draw

__all__ = ["Model", "class_named", "model_named", "picture_named"]


def model_named(name: str) -> Model:
    """A class of furniture or an instance of goods; raises KeyError."""
    return MODELS[name] if name in MODELS else goods_model(name)


def class_named(name: str) -> str:
    """The class of a model: a piece of furniture is its own; raises KeyError."""
    return name if name in MODELS else goods_class(name)


def picture_named(name: str) -> Picture:
    """A picture of textures.PICTURES, or ``<instance>/<side>`` of goods; raises KeyError."""
    return goods_picture(name) if "/" in name else draw(name)
