"""One calibration run of the bag under one configuration, and its evidence."""

import io
import shutil
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.errors import SemanticSlamError, one_line
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.record import Record
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.pipeline.offline import run_bag


@dataclass(frozen=True, kw_only=True)
class Drive:
    """The bag, and the part of it that is run."""

    bag: Path
    map_prior: MapPrior | None = None
    max_keyframes: int | None = None


@dataclass(frozen=True)
class Weighed:
    """Outcome of a run over a drive."""

    log_evidence: float  # nats, of the whole drive; -inf: not comparable
    belief_bag: Path
    num_keyframes: int = 0
    num_detections: int = 0
    noise: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # final estimates: name -> mean, sigma
    fault: str = ""  # why it cannot be compared
    damage: str = ""  # why the bag was not read to its end

    def beside(self, first: "Weighed") -> "Weighed":
        """This outcome; not comparable where its numbers of keyframes or detections differ from those of ``first``."""
        size = self.num_keyframes, self.num_detections
        if self.fault or size == (first.num_keyframes, first.num_detections):
            return self
        return Weighed(-np.inf, self.belief_bag, *size, fault=f"{size[0]} keyframes with {size[1]} detections were run")


def weigh(drive: Drive, configuration: Configuration, belief_bag: Path) -> Weighed:
    """Run the drive silently into ``belief_bag``. A failed run has evidence -inf and a ``fault``."""
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            summary = run_bag(drive.bag, belief_bag, configuration, drive.map_prior, drive.max_keyframes)
            record = read_record(belief_bag)
    except SemanticSlamError as fault:
        return Weighed(-np.inf, belief_bag, fault=one_line(fault))
    return weighed(record, belief_bag, str(summary.fault or ""))


def weighed(record: Record, belief_bag: Path, damage: str = "") -> Weighed:
    """Outcome of a recorded run: log evidence as the sum over keyframes of log P(Z_k | Z_1:k-1)."""
    last = record.beliefs[-1]
    noise = zip(last.noise_values.tolist(), last.noise_sigmas.tolist(), strict=True)
    return Weighed(
        float(sum(belief.log_evidence for belief in record.beliefs)),
        belief_bag,
        len(record.beliefs),
        sum(len(belief.detection_ids) for belief in record.beliefs),
        dict(zip(last.noise_names, noise, strict=True)),
        damage=damage,
    )


def forget(outcome: Weighed) -> None:
    """Delete the beliefs of a run that is no longer needed."""
    shutil.rmtree(outcome.belief_bag, ignore_errors=True)
