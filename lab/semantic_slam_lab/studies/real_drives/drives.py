"""The real drives below a folder, and each as a bag."""

import os
import re
from dataclasses import dataclass
from pathlib import Path

from semantic_slam.cli import import_dataset
from semantic_slam.errors import InputError

DATA = "SEMANTIC_SLAM_DATA"
"""Environment variable that names the folder of the data sets where the command line does not."""
MRCLAM, KITTI, DLR = "mrclam", "kitti_tracking", "dlr"
ROBOT = re.compile(r"Robot(\d+)_Measurement\.dat(\.gz)?")
BEGINNING = 12
"""Frames imported for each keyframe that is run: most lie between keyframes."""
LABELS = re.compile(r"det_(\d+)\.txt(\.gz)?")


@dataclass(frozen=True)
class Drive:
    """One drive: its name, and what ``import_dataset`` is asked for to make a bag of it."""

    name: str
    kind: str  # MRCLAM, KITTI or DLR
    folder: Path
    words: tuple[str, ...]

    def write_bag(self, bag: Path, *, with_robots: bool = False, max_keyframes: int | None = None) -> None:
        """Import it, all or the beginning, in which there are ``max_keyframes``. Raises InputError.

        ``with_robots``: MRCLAM with the sightings of other robots.
        """
        extra = ["--robots"] if with_robots else []
        extra += ["--max-keyframes", str(BEGINNING * max_keyframes)] if max_keyframes is not None else []
        module, arguments = import_dataset.parse([*self.words, "--out", str(bag), *extra])
        module.run(arguments, bag)


def data_folder(given: Path | None) -> Path:
    """The folder of the data sets: as given, else as the environment names it. Raises InputError."""
    if given is None and not os.environ.get(DATA):
        raise InputError(f"real_drives: no data; name their folder with --data or {DATA}")
    folder = given or Path(os.environ[DATA])
    if not folder.is_dir():
        raise InputError(f"{folder}: no folder; name that of the data sets with --data")
    return folder


def drives_in(data: Path) -> dict[str, Drive]:
    """Name -> drive, of all below ``data``: ``mrclam_*/ROBOT``, ``dlr``, ``kitti_tracking/NNNN``. Raises InputError."""
    found: list[Drive] = []
    for folder in sorted(data.glob("mrclam_*")):
        for number in _numbers(folder, ROBOT):
            words = (MRCLAM, str(folder), "--robot", number)
            found.append(Drive(f"{folder.name}/{number}", MRCLAM, folder, words))
    graphs = sorted((data / DLR).glob("dlr.g2o*"))
    found += [Drive(DLR, DLR, data / DLR, ("g2o", str(path))) for path in graphs[:1]]
    for number in _numbers(data / KITTI, LABELS):
        words = (KITTI, str(data / KITTI), "--drive", number)
        found.append(Drive(f"{KITTI}/{number}", KITTI, data / KITTI, words))
    if not found:
        raise InputError(f"{data}: holds none of mrclam_*, {DLR}, {KITTI}; name the folder of the data sets")
    return {drive.name: drive for drive in found}


def chosen_drives(data: Path, names: list[str] | None) -> list[Drive]:
    """The drives of these names, all without names. Raises InputError for one that is not there."""
    known = drives_in(data)
    for name in names or ():
        if name not in known:
            raise InputError(f"{data}: no drive '{name}'; there are {', '.join(known)}")
    return [known[name] for name in names or known]


def _numbers(folder: Path, pattern: re.Pattern[str]) -> list[str]:
    names = sorted(path.name for path in folder.glob("*")) if folder.is_dir() else []
    matches = [pattern.fullmatch(name) for name in names]
    return sorted({match[1] for match in matches if match})
