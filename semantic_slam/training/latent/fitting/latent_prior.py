"""Priors over the descriptors of the instances (Eq. 5.11): they keep instances apart and the space of unit size."""

from collections.abc import Callable

import torch

MARGIN = 2.0
"""Margin of the contrastive loss: instances further apart than this do not repel each other."""
SIZE_WEIGHT = 0.05


def contrastive(descriptors: torch.Tensor) -> torch.Tensor:
    """Negative log prior of (N, L) descriptors after Chopra, Hadsell and LeCun, per instance.

    Views of one instance share their descriptor already, so that of the two halves only the repulsion remains.
    """
    distance = torch.pdist(descriptors)
    return torch.relu(MARGIN - distance).square().sum() / len(descriptors) + _size(descriptors)


def n_pairs(descriptors: torch.Tensor) -> torch.Tensor:
    """Negative log prior of (N, L) descriptors after Sohn: each closer to itself than to all others, per instance."""
    product = descriptors @ descriptors.T
    return (torch.logsumexp(product, dim=1) - product.diagonal()).mean() + _size(descriptors)


def _size(descriptors: torch.Tensor) -> torch.Tensor:
    return SIZE_WEIGHT * descriptors.square().sum(dim=1).mean()


PRIORS: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {"contrastive": contrastive, "n_pairs": n_pairs}
"""Contrastive losses by name."""
