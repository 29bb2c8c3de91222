"""Turntables and a scene, given or simulated, and a track of views of one object in the scene."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.datasets.avd.objects import TrueObject, triangulated_prior, true_objects
from semantic_slam.datasets.avd.scene import AvdImage, AvdScene, find_scene, read_scene
from semantic_slam.datasets.bigbird import object_folders
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector

PREFERRED = ("aunt_jemima_original_syrup", "desk")
"""Objects of interest: the thesis's, and the one of the simulated room that shares the most sides with others."""
MAX_DIFFICULTY = 3
BIN_DEG, QUICK_STEP_DEG, STEP_DEG = 24.0, 9, 3
LEAST_VIEWS = 4


@dataclass(frozen=True)
class Sources:
    """Where the pictures are."""

    scene: AvdScene
    turntables: Mapping[str, Path]  # class -> folder
    simulated: bool


@dataclass(frozen=True)
class SceneTrack:
    """Views of one object, in the order of their azimuth."""

    object_name: str
    class_name: str
    heading_known: bool
    planar: Array  # (3,) x, y, yaw of the object in map
    images: tuple[str, ...]  # (K,)
    boxes: Array  # (K, 4)
    cameras_m: Array  # (K, 2) in map

    @property
    def locations_m(self) -> Array:
        """(K, 2) cameras relative to the object, in its frame."""
        return in_object_frame(self.cameras_m, self.planar)


def in_object_frame(places_m: Array, planar: Array) -> Array:
    """(K, 2) places of map in the frame of an object at (3,) x, y, yaw."""
    c, s = np.cos(planar[2]), np.sin(planar[2])
    return np.asarray((places_m - planar[:2]) @ np.array([[c, -s], [s, c]]))


def open_sources(cache: Path, avd: Path | None, bigbird: Path | None, seed: int, quick: bool) -> Sources:
    """The given folders, or simulated ones that are kept in ``cache``; raises InputError."""
    if (avd is None) != (bigbird is None):
        raise InputError("--avd, --bigbird: the models of one are for the objects of the other; give both or neither")
    scene = avd or _cached(cache / f"avd_{seed}{'_tour' if quick else ''}", lambda to: _render_scene(to, seed, quick))
    step = QUICK_STEP_DEG if quick else STEP_DEG
    tables = bigbird or _cached(cache / f"bigbird_{step}", lambda to: _render_turntables(to, step))
    folders = {folder.name: folder for folder in object_folders(tables)}
    return Sources(read_scene(find_scene(scene)), folders, avd is None)


def choose_track(sources: Sources) -> SceneTrack:
    """The best seen object of the preferred class, or of any with a turntable; raises InputError without one."""
    known = [track for track in map(lambda each: _track(sources.scene, *each), _objects(sources.scene)) if track]
    usable = [track for track in known if track.class_name in sources.turntables]
    if not usable:
        raise InputError(
            f"{sources.scene.folder}: no object that a turntable shows is seen from {LEAST_VIEWS} sides; its names must"
            " be those of the turntables' folders"
        )
    return max(usable, key=lambda track: (track.class_name in PREFERRED, len(track.images)))


def _objects(scene: AvdScene) -> list[tuple[TrueObject, bool]]:
    """True objects, each with whether its heading is known: the real data set does not tell it."""
    truth = true_objects(scene)
    if truth:
        return [(each, True) for each in truth]
    prior = triangulated_prior(scene, MAX_DIFFICULTY)
    return [
        (TrueObject(each.object_id, scene.instance_names.get(each.object_id, each.name), each.pose), False)
        for each in prior.objects
    ]


def _track(scene: AvdScene, known: TrueObject, heading_known: bool) -> SceneTrack | None:
    """One view per bin of azimuth, that with the largest box; starts behind the widest gap."""
    planar = planar_from_pose_vector(known.pose)
    best: dict[int, tuple[float, float, AvdImage, Array]] = {}
    for image in scene.images.values():
        for row in np.flatnonzero((image.instance_ids == known.object_id) & (image.difficulties <= MAX_DIFFICULTY)):
            x, y = in_object_frame(image.T_map_camera[None, :2, 3], planar)[0]
            azimuth = float(np.rad2deg(np.arctan2(y, x)) % 360.0)
            box = image.boxes[row]
            area = float(np.prod(box[2:] - box[:2]))
            bin_of = int(azimuth // BIN_DEG)
            if not image.rebuilt and (bin_of not in best or area > best[bin_of][1]):
                best[bin_of] = (azimuth, area, image, box)
    if len(best) < LEAST_VIEWS:
        return None
    rows = _from_widest_gap(sorted(best.values(), key=lambda entry: entry[0]))
    return SceneTrack(
        scene.instance_names.get(known.object_id, known.class_name),
        known.class_name,
        heading_known,
        planar,
        tuple(image.name for _, _, image, _ in rows),
        np.stack([box for *_, box in rows]),
        np.stack([image.T_map_camera[:2, 3] for _, _, image, _ in rows]),
    )


def _from_widest_gap(rows: list[tuple[float, float, AvdImage, Array]]) -> list[tuple[float, float, AvdImage, Array]]:
    azimuths = np.array([row[0] for row in rows])
    gaps = (azimuths - np.roll(azimuths, 1)) % 360.0
    first = int(gaps.argmax())
    return rows[first:] + rows[:first]


def _cached(folder: Path, render: Callable[[Path], object]) -> Path:
    """``folder``, rendered unless it is there; a run that was broken off leaves nothing that looks whole."""
    if not folder.exists():
        unfinished = folder.with_name(folder.name + ".part")
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.mkdir(parents=True)
        render(unfinished)
        unfinished.rename(folder)
    return folder


def _render_scene(folder: Path, seed: int, quick: bool) -> None:
    from semantic_slam_lab.simulation.scene import SceneSettings, make_scene

    make_scene(folder, seed, SceneSettings(tour_only=quick))


def _render_turntables(folder: Path, step_deg: int) -> None:
    from semantic_slam_lab.simulation.furniture import MODELS
    from semantic_slam_lab.simulation.turntable import TurntableSettings, write_turntables

    write_turntables(folder, tuple(MODELS), TurntableSettings(step_deg=step_deg))
