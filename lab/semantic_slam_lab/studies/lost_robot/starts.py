"""Where a drive is begun in its middle, and what the robot is told: the map, and a place that is metres off."""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.datasets.drives import drive as drives
from semantic_slam.datasets.drives.mrclam_import import read_drive
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam_lab.studies.real_drives.drives import Drive

TIMES_S = (0.0, 120.0, 240.0, 360.0)
"""Seconds from the beginning of a drive."""
BLIND_S = 15.0
"""A start in a longer stretch without detections is moved to just before its end."""
LEAD_S = 0.5
LOST_M = 10.0
"""Standard deviation of the initial pose, and the most that its mean is off."""
SURVEY_SIGMA_M, SURVEY_SIGMA_RAD = 0.02, 1.0
"""Standard deviations of the landmarks on the map; they have no heading."""


@dataclass(frozen=True)
class Start:
    """A drive from some time on; poses in the frame of its first true one."""

    name: str
    drive: drives.Drive
    prior: MapPrior  # all landmarks

    def configuration(self, base: Configuration, seed: int) -> Configuration:
        """``base`` with an initial pose up to :data:`LOST_M` off, in any direction, with any heading."""
        random = np.random.default_rng([seed, self.drive.frames[0].stamp_ns])
        away, direction = LOST_M * np.sqrt(random.random()), random.uniform(-np.pi, np.pi)
        mean = (away * np.cos(direction), away * np.sin(direction), random.uniform(-np.pi, np.pi))
        told = replace(base.initial_pose, mean=tuple(map(float, mean)), sigma=(LOST_M, LOST_M, 3.14))
        return replace(base, initial_pose=told)


def starts_of(own: Drive, times_s: tuple[float, ...] = TIMES_S) -> list[Start]:
    """The starts of one robot. Raises InputError."""
    whole, _ = read_drive(own.folder, int(own.name.rpartition("/")[2]), with_robots=False)
    return [_start(own.name, whole, time_s) for time_s in times_s]


def _start(name: str, whole: drives.Drive, time_s: float) -> Start:
    begin_ns = int(whole.odometry.stamps_ns[0])
    seen_s = np.array([(frame.stamp_ns - begin_ns) / 1e9 for frame in whole.frames if len(frame)])
    after = min(int(np.searchsorted(seen_s, time_s)), len(seen_s) - 1)
    last_s = seen_s[after - 1] if after else 0.0
    if seen_s[after] - last_s > BLIND_S:
        time_s = float(seen_s[after]) - LEAD_S
    part = drives.in_frame_of_start(drives.since(whole, begin_ns + round(time_s * 1e9)))
    assert part.objects is not None
    rows = zip(part.objects.object_ids, part.objects.positions.tolist(), strict=True)
    landmarks = [
        ObjectPrior.planar(n, x, y, sigma_m=SURVEY_SIGMA_M, sigma_rad=SURVEY_SIGMA_RAD, name=barcode)
        for n, (barcode, (x, y)) in enumerate(rows)
    ]
    return Start(f"{name} from {time_s:.1f} s", part, MapPrior(tuple(landmarks)))
