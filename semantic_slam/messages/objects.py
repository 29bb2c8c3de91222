"""Layout of what messages tell of every object, from the declarations of the object table."""

from semantic_slam.inference.object_table import QUANTITIES
from semantic_slam.messages.layout import Layout, MayBeEmpty


def object_layout(*leading: str) -> Layout:
    """Every per-object quantity, with ``leading`` dimensions: S x O of components, O of a belief."""
    return {
        name: MayBeEmpty((*leading, *item.shape)) if item.may_be_left_out else (*leading, *item.shape)
        for name, item in QUANTITIES.items()
    }
