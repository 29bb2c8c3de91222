"""Message layout of the per-object quantities, derived from the object table's declarations."""

from semantic_slam.inference.object_table import QUANTITIES
from semantic_slam.messages.layout import Layout, MayBeEmpty


def object_layout(*leading: str) -> Layout:
    """Layout of every per-object quantity with ``leading`` dimensions: S x O for components, O for a belief."""
    return {
        name: MayBeEmpty((*leading, *item.shape)) if item.may_be_left_out else (*leading, *item.shape)
        for name, item in QUANTITIES.items()
    }
