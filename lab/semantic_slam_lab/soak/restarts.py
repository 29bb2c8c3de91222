"""What the journal of a long run takes on disk, and what a manager's restart from it costs."""

import shutil
import time
from collections.abc import Callable, Collection, Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

from tqdm import tqdm

from semantic_slam.configuration import Configuration
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.pipeline.journal.kept_runs import PREFIX
from semantic_slam_lab.soak.journaled_manager import LivingPool, Manager, events_of
from semantic_slam_lab.soak.measures import Row
from semantic_slam_lab.soak.tour import Tour

AT = (300, 600, 1200)
"""Keyframes after which a manager is restarted."""


def restarted(
    configuration: Configuration, map_prior: MapPrior | None, at: Collection[int], seed: int, *, snapshots: bool
) -> Iterator[Row]:
    """Drive a manager with a journal; a row after each of these numbers of keyframes, at which another one restarts.

    ``snapshots`` False: the journal is never begun anew.
    """
    made = partial(Manager, configuration=configuration, map_prior=map_prior, snapshots=snapshots)
    tour = (seen.keyframe for seen in islice(Tour(configuration, seed).keyframes(), max(at)))
    with TemporaryDirectory() as place:
        folder, number = Path(place) / "journal", 0
        manager = made(folder)
        for event in events_of(tqdm(tour, total=max(at), unit="keyframe")):
            manager.receive(event)
            number += event[0] == topics.MEASUREMENTS
            if event[0] == topics.MEASUREMENTS and number in at:
                yield {
                    "keyframes": number,
                    **_kilobytes(folder),
                    "snapshots_ms": 1e3 * manager.snapshots_s / number,
                    **_restart(manager, partial(made, shutil.copytree(folder, folder / ".." / str(number)))),
                }
        manager.close()


def _kilobytes(folder: Path) -> Row:
    """Kilobytes of the journal, and of the keyframes that are kept beside it and not read at a restart."""
    sizes = {path.name: path.stat().st_size / 1e3 for path in folder.iterdir()}
    kept = sum(size for name, size in sizes.items() if name.startswith(PREFIX))
    return {"journal_kb": sum(sizes.values()) - kept, "keyframes_kb": kept}


def _restart(manager: Manager, made: Callable[..., Manager]) -> Row:
    """CPU time of another manager until it stands where this one does, whose backends live on."""
    begin = time.process_time()
    other = made(pool=LivingPool(manager.pool))
    spent = time.process_time() - begin
    other.close()
    return {"restart_s": spent, "replayed": len(other.beliefs)}
