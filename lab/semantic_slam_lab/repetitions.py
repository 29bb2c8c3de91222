"""Repetitions of an experiment: keyed random numbers, processes or a cluster, a bar that tells how far it is."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any, TypeVar

import numpy as np
from joblib import Parallel, delayed, parallel_config
from tqdm import tqdm

from semantic_slam.cluster import connected

Task = TypeVar("Task")
Result = TypeVar("Result")


def keyed_generator(*key: str | int) -> np.random.Generator:
    """Generator that gives the same numbers for the same key, whatever else is drawn and on whichever machine."""
    text = ":".join(str(part) for part in key)
    digest = hashlib.blake2b(text.encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))


def own_numbers(seed: int, count: int, whole: int) -> range:
    """``count`` numbers of rooms that no other seed shares, where a whole run takes ``whole`` of them."""
    return range(seed * whole, seed * whole + count)


def repeat(
    function: Callable[..., Result], arguments: Sequence[tuple[Any, ...]], jobs: int, description: str
) -> list[Result]:
    """``function(*arguments[i])`` for all i, in their order; ``jobs`` processes here, or the cluster's workers."""
    tasks = (delayed(function)(*each) for each in arguments)
    results = Parallel(n_jobs=jobs, return_as="generator")(tasks)
    return list(tqdm(results, total=len(arguments), desc=description))


def apart(
    function: Callable[[Task], Result], tasks: Sequence[Task], jobs: int, description: str, *, shared: bool = False
) -> list[Result]:
    """``function`` of every task, in their order, each in a fresh process, so that memory is that of one run.

    ``shared``: ``jobs`` processes for all of them, where nobody asks what one takes; one job is done in this process.
    """
    if shared and jobs == 1:
        return [function(task) for task in tqdm(tasks, desc=description, unit="run")]
    with ProcessPoolExecutor(jobs, get_context("spawn"), max_tasks_per_child=None if shared else 1) as pool:
        return list(tqdm(pool.map(function, tasks), total=len(tasks), desc=description, unit="run"))


@contextmanager
def scheduler(address: str | None) -> Iterator[None]:
    """Within it joblib's work goes to the Dask scheduler at ``address``, if there is one; raises InputError."""
    if address is None:
        yield
        return
    with connected(address) as client, parallel_config(backend="dask", client=client):
        yield
