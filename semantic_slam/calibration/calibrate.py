"""Calibration: the configuration under which a bag has the highest evidence."""

from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from itertools import count
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from tqdm import tqdm

from semantic_slam.bag.reader import BagReader
from semantic_slam.calibration.quantities import quantities
from semantic_slam.calibration.search import Change, Search, Trial
from semantic_slam.calibration.trial import Drive, Weighed, weigh
from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.record import Record
from semantic_slam.pipeline.input_topics import find_topics


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Result of a calibration, with its inputs."""

    drive: Drive
    before: Configuration
    after: Configuration
    changes: dict[str, Change]  # by dotted name
    trials: list[Trial]  # in the order in which they were run
    first: Weighed  # the run before
    last: Weighed  # the run after
    record_before: Record
    record_after: Record

    @property
    def gain(self) -> float:
        """Gain of log evidence of the drive, in nats."""
        return self.last.log_evidence - self.first.log_evidence


class Runs:
    """Runs one drive under several configurations in parallel; beliefs go to the folder ``scratch``."""

    def __init__(self, drive: Drive, scratch: Path, jobs: int, progress: tqdm) -> None:
        self._drive, self._scratch, self._progress = drive, scratch, progress
        self._numbers = count()
        self._pool = ProcessPoolExecutor(jobs, get_context("spawn")) if jobs > 1 else None

    def weigh(self, configurations: Sequence[Configuration]) -> list[Weighed]:
        """Outcome of each configuration, in the given order."""
        folders = [self._scratch / f"belief_{next(self._numbers)}" for _ in configurations]
        if self._pool is None:
            return [self._counted(weigh(self._drive, *own)) for own in zip(configurations, folders, strict=True)]
        running: list[Future[Weighed]] = [
            self._pool.submit(weigh, self._drive, *own) for own in zip(configurations, folders, strict=True)
        ]
        return [self._counted(future.result()) for future in running]

    def close(self) -> None:
        """Shut down the worker processes; pending runs are cancelled."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def _counted(self, outcome: Weighed) -> Weighed:
        self._progress.update()
        return outcome


def calibrate(drive: Drive, configuration: Configuration, scratch: Path, jobs: int = 1) -> Calibration:
    """Search for the best configuration; beliefs of the runs go to the folder ``scratch``. Raises InputError.

    The first run uses ``configuration`` unchanged. Ground truth in the bag is not used.
    """
    with tqdm(unit="run", desc="runs") as progress:
        runs = Runs(drive, scratch, jobs, progress)
        try:
            (first,) = runs.weigh([configuration])
            if first.fault:
                raise InputError(first.fault)
            before = read_record(first.belief_bag)
            searched = quantities(configuration, places_are_told=_places_are_told(drive.bag, before))
            search = Search(runs.weigh, configuration, first)
            search.climb(searched)
            search.refine()
        finally:
            runs.close()
    return Calibration(
        drive=drive,
        before=configuration,
        after=search.best,
        changes=search.changes,
        trials=search.trials,
        first=first,
        last=search.outcome,
        record_before=before,
        record_after=read_record(search.outcome.belief_bag),
    )


def _places_are_told(bag: Path, record: Record) -> bool:
    """Whether detections carry position covariances, which override the configured noise."""
    with BagReader(bag) as reader:
        if find_topics(bag, reader.topics).has_images:
            return False
    return any(np.isfinite(own.geometric_covariances[:, 1, 1]).any() for own in record.measurements.values())
