"""One way to train: AdamW over a known number of batches, its rate rising and falling once."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from semantic_slam.geometry.arrays import Index

Groups = list[dict[str, Any]]
"""Parameters with their largest rate each, as torch.optim takes them: {"params": …, "lr": …}."""

TOLD_EVERY = 50
"""Steps between two words on the loss."""


def descend(
    groups: Groups,
    loss_of: Callable[[Index], torch.Tensor],
    batches: Iterable[Index],
    total: int,
    description: str,
    weight_decay: float = 0.0,
) -> None:
    """Minimise ``loss_of`` each of the ``total`` batches of rows; the parameters are changed in place."""
    optimiser = torch.optim.AdamW(groups, weight_decay=weight_decay)
    rates = [group["lr"] for group in groups]
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rates, total_steps=max(total, 1))
    progress = tqdm(batches, total=total, desc=description, unit="step")
    for step, rows in enumerate(progress):
        loss = loss_of(rows)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % TOLD_EVERY == 0:
            progress.set_postfix(loss=f"{loss.item():.4f}")


def drawn(count: int, batch_size: int, steps: int, generator: np.random.Generator) -> Iterator[Index]:
    """``steps`` batches of rows below ``count``, drawn with replacement."""
    return (generator.integers(count, size=batch_size) for _ in range(steps))


def shuffled(count: int, batch_size: int, epochs: int, generator: np.random.Generator) -> Iterator[Index]:
    """``epochs`` times all rows below ``count`` in another order; what fills no batch is left to the next time."""
    for _ in range(epochs):
        order = generator.permutation(count)
        for step in range(num_batches(count, batch_size)):
            yield order[step * batch_size : (step + 1) * batch_size]


def num_batches(count: int, batch_size: int) -> int:
    """Number of batches in one epoch, at least one."""
    return max(count // batch_size, 1)
