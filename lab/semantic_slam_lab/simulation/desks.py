"""A hand-held camera that walks about two desks with a box detector and no depth, as a folder like TUM's fr3 office.

Nothing is rendered: things are boxes, their corners are projected, and a detector reports what they span in the
picture, the middle of which is not quite that of the thing; with errors that stay for a while, others that come back
whenever a thing is seen from that side, names that are sometimes wrong, misses that last and false alarms.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import ndtri

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.perception.frame import CameraModel

KINDS = {
    "tv": (0.50, 0.20, 0.40),
    "laptop": (0.34, 0.26, 0.22),
    "keyboard": (0.44, 0.15, 0.03),
    "mouse": (0.06, 0.11, 0.04),
    "cup": (0.09, 0.09, 0.10),
    "bottle": (0.08, 0.08, 0.24),
    "book": (0.17, 0.24, 0.04),
    "potted plant": (0.25, 0.25, 0.40),
    "teddy bear": (0.25, 0.20, 0.30),
    "chair": (0.55, 0.55, 0.90),
}
"""Name -> width, depth, height [m]."""
ON_DESKS = ("tv", "laptop", "keyboard", "mouse", "cup", "bottle", "book", "cup", "bottle", "book", "potted plant")
OTHERS = ("cell phone", "remote", "bowl", "vase", "backpack", "suitcase", "person", "clock")
"""Further names of the detector, which nothing deserves."""
DESKS = np.array([[0.0, 0.45], [0.0, -0.45]])
"""Centres [m]; back to back."""
DESK_SIZE_M, DESK_HEIGHT_M = np.array([2.4, 0.8]), 0.74
CHAIRS = np.array([[-0.7, 1.35], [0.8, 1.3], [-0.6, -1.3], [0.9, -1.4]])
LEAST_GAP_M, TRIES = 0.04, 2000
LOOP_M, HEIGHT_M, ROUNDS = np.array([2.2, 1.9]), 1.4, 1.15
CAMERA = CameraModel(640, 480, 535.4, 539.2, 320.1, 247.6)
RATE_HZ, TRUTH_RATE_HZ = 30.0, 100.0
EDGE_FIXES_S, MISS_FIXES_S = 0.5, 0.4
"""Time constants of what is wrong with a box, and of whether a thing can be detected at all."""
LEAST_SHOWN = 0.35
"""Share of a thing's box that has to lie in the picture, and before other things, to be detected."""
LEAST_SIDE_PX = 12.0
FARTHEST_M = 3.5


@dataclass(frozen=True, kw_only=True)
class Office:
    """What stands in an office, how it is walked through, and how the detector errs."""

    things: int = 30
    seconds: float = 87.0
    edge_share: float = 0.04  # standard deviation of each edge of a box, of its side
    edge_px: float = 1.5  # and besides
    settled_share: float = 0.04  # likewise, of what is wrong with an edge whenever the thing is seen from that side
    missed: float = 0.4
    confused: float = 0.15
    alarms_per_frame: float = 0.3


@dataclass(frozen=True, kw_only=True)
class Things:
    """N boxes that stand."""

    names: tuple[str, ...]
    centres: Array  # (N, 3)
    corners: Array  # (N, 8, 3)


def write_office(folder: Path, office: Office, random: np.random.Generator) -> Things:
    """Draw an office, walk through it and write what ``import_dataset tum_rgbd`` reads; its things are returned."""
    folder.mkdir(parents=True, exist_ok=True)
    things = _things(office.things, random)
    times = np.arange(round(office.seconds * TRUTH_RATE_HZ)) / TRUTH_RATE_HZ
    path = _path(times, office.seconds, random)
    lines = [
        " ".join([f"{time + 1e6:.4f}", *(f"{v:.7f}" for v in pose)]) for time, pose in zip(times, path, strict=True)
    ]
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")
    camera = CAMERA
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    (folder / "camera.txt").write_text(" ".join(map(str, numbers)) + "\n")
    frames = np.round(np.arange(0.0, times[-1], 1.0 / RATE_HZ) * TRUTH_RATE_HZ).astype(int)
    rows = _detections(things, times[frames] + 1e6, path[frames], office, random)
    header = "stamp_s,label,score,x_min,y_min,x_max,y_max,object_id"
    (folder / "detections.csv").write_text("\n".join([header, *rows]) + "\n")
    objects = [
        f"{n},{x:.5f},{y:.5f},{z:.5f},{name}"
        for n, ((x, y, z), name) in enumerate(zip(things.centres, things.names, strict=True))
    ]
    (folder / "objects.csv").write_text("\n".join(["object_id,x,y,z,class", *objects]) + "\n")
    return things


def _things(count: int, random: np.random.Generator) -> Things:
    """Chairs on the floor, the rest on the desks, no two in one place."""
    names = [ON_DESKS[n % len(ON_DESKS)] for n in range(count - len(CHAIRS))]
    names.sort(key=lambda name: -_radius(name))  # what is large finds no room later
    boxes = [_box(place, 0.0, "chair", random) for place in CHAIRS]
    taken: list[tuple[Array, float]] = []
    for name in names:
        place = _free_place(name, taken, random)
        taken.append((place, _radius(name)))
        boxes.append(_box(place, DESK_HEIGHT_M, name, random))
    names = ["chair"] * len(CHAIRS) + names
    corners = np.array(boxes)
    return Things(names=tuple(names), centres=corners.mean(axis=1), corners=corners)


def _radius(name: str) -> float:
    return 0.4 * float(np.hypot(*KINDS[name][:2]))


def _free_place(name: str, taken: list[tuple[Array, float]], random: np.random.Generator) -> Array:
    """(2,) on the desks, the first of many that is far enough from what stands there, or the one that is farthest."""
    half = 0.5 * DESK_SIZE_M - 0.5 * np.array(KINDS[name][:2])
    places = DESKS[random.integers(len(DESKS), size=TRIES)] + half * random.uniform(-1.0, 1.0, (TRIES, 2))
    if not taken:
        return np.asarray(places[0])
    centres, radii = np.array([place for place, _ in taken]), np.array([radius for _, radius in taken])
    gaps = (np.linalg.norm(places[:, None] - centres, axis=2) - radii).min(axis=1) - _radius(name)
    fits = np.flatnonzero(gaps >= LEAST_GAP_M)
    return np.asarray(places[fits[0] if len(fits) else int(gaps.argmax())])


def _box(place: Array, floor_m: float, name: str, random: np.random.Generator) -> Array:
    """(8, 3) corners."""
    width, depth, height = KINDS[name]
    yaw = (
        random.uniform(-np.pi, np.pi) if name in ("cup", "bottle", "chair", "potted plant") else random.normal(0.0, 0.2)
    )
    signs = np.array([[x, y] for x in (-0.5, 0.5) for y in (-0.5, 0.5)]) * [width, depth]
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    level = place + signs @ turn.T
    return np.concatenate([np.column_stack([level, np.full(4, z)]) for z in (floor_m, floor_m + height)])


def _path(times: Array, seconds: float, random: np.random.Generator) -> Array:
    """(N, 7) poses of the optical frame: around the desks, looking at them, with a hand that sways."""
    sway, turn = _sway(times, 6, random), 2.0 * np.pi * ROUNDS * times / seconds
    places = np.column_stack([LOOP_M[0] * np.cos(turn), LOOP_M[1] * np.sin(turn), np.full(len(times), HEIGHT_M)])
    places += sway[:, :3] * [0.12, 0.12, 0.08]
    targets = np.column_stack([0.5 * np.cos(turn + 0.6), 0.4 * np.sin(turn + 0.6), np.full(len(times), 0.75)])
    away = targets - places
    yaw, down = np.arctan2(away[:, 1], away[:, 0]), np.arctan2(-away[:, 2], np.hypot(away[:, 0], away[:, 1]))
    turns = np.zeros((3, len(times), 3))
    turns[0, :, 2], turns[1, :, 1], turns[2] = yaw, down, 0.07 * sway[:, 3:]
    level = so3.product(so3.exp(turns[0]), so3.exp(turns[1]))
    optical = so3.product(so3.product(level, so3.exp(turns[2])), np.array([-0.5, 0.5, -0.5, 0.5]))
    return se3.wrapped(np.concatenate([places, optical], axis=1))


def _sway(times: Array, size: int, random: np.random.Generator) -> Array:
    """(N, size) sums of slow waves of standard deviation 1."""
    rates, phases = random.uniform(0.05, 0.3, (4, size)), random.uniform(0.0, 2.0 * np.pi, (4, size))
    return np.asarray(np.sin(2.0 * np.pi * rates * times[:, None, None] + phases).sum(axis=1) / np.sqrt(2.0))


def _detections(things: Things, stamps: Array, poses: Array, office: Office, random: np.random.Generator) -> list[str]:
    """Lines of ``detections.csv``."""
    count, rows = len(things.names), list[str]()
    settled = random.normal(size=(3, count, 4)) / np.sqrt(2.0)
    errors, moods = np.zeros((count, 4)), random.normal(size=count)
    keep_error, keep_mood = np.exp(-1.0 / (RATE_HZ * np.array([EDGE_FIXES_S, MISS_FIXES_S])))
    threshold = ndtri(office.missed)
    called = {n: things.names[n] for n in range(count)}
    for stamp, pose in zip(stamps, poses, strict=True):
        errors = keep_error * errors + np.sqrt(1.0 - keep_error**2) * random.normal(size=errors.shape)
        moods = keep_mood * moods + np.sqrt(1.0 - keep_mood**2) * random.normal(size=count)
        boxes, are_shown = _boxes(things, pose)
        found = []
        for n in np.flatnonzero(are_shown & (moods > threshold)).tolist():
            if random.random() < 0.1:  # what a thing is called stays for some pictures
                called[n] = _name(things.names[n], office, random)
            size = np.tile(boxes[n, 2:] - boxes[n, :2], 2)
            sigma = np.hypot(office.edge_share * size, office.edge_px)
            of_side = office.settled_share * size * (_seen_from(things.centres[n] - pose[:3]) @ settled[:, n])
            box = _clipped(boxes[n] + sigma * errors[n] + of_side)
            found.append((box, called[n], random.uniform(0.4, 0.95), str(n)))
        for _ in range(random.poisson(office.alarms_per_frame)):
            found.append((_alarm(random), str(random.choice([*KINDS, *OTHERS])), random.uniform(0.3, 0.6), ""))
        for row in random.permutation(len(found)).tolist():
            box, name, score, thing = found[row]
            sides = ",".join(f"{value:.2f}" for value in box)
            if (box[2:] - box[:2]).min() >= LEAST_SIDE_PX / 2.0:
                rows.append(f"{stamp:.6f},{name},{score:.3f},{sides},{thing}")
    return rows


def _seen_from(away: Array) -> Array:
    """(3,) of what changes slowly with the side from which a thing is seen: a constant and one wave about it."""
    side = np.arctan2(away[1], away[0])
    return np.array([1.0, np.cos(side), np.sin(side)])


def _boxes(things: Things, pose: Array) -> tuple[Array, Flags]:
    """(N, 4) boxes in the picture's plane, not clipped, and (N,) whether each can be detected."""
    seen = (things.corners - pose[:3]) @ rotation_matrix(pose[3:])
    depth = seen[..., 2]
    ahead = (depth > 0.2).all(axis=1) & (depth.min(axis=1) < FARTHEST_M)
    safe = np.where(depth > 0.2, depth, 1.0)
    u, v = CAMERA.fx * seen[..., 0] / safe + CAMERA.cx, CAMERA.fy * seen[..., 1] / safe + CAMERA.cy
    boxes = np.stack([u.min(axis=1), v.min(axis=1), u.max(axis=1), v.max(axis=1)], axis=1)
    clipped = _clipped(boxes)
    shown = _areas(clipped) / np.maximum(_areas(boxes), 1e-9)
    distances = np.linalg.norm(seen.mean(axis=1), axis=1)
    hidden = np.array([_hidden_share(n, clipped, distances, ahead) for n in range(len(boxes))])
    large = (clipped[:, 2:] - clipped[:, :2]).min(axis=1) >= LEAST_SIDE_PX
    return boxes, ahead & large & (shown >= LEAST_SHOWN) & (1.0 - hidden >= LEAST_SHOWN)


def _hidden_share(n: int, boxes: Array, distances: Array, ahead: Flags) -> float:
    """Share of a box that the largest of the nearer boxes covers."""
    nearer = ahead & (distances < distances[n] - 0.05)
    if not nearer.any():
        return 0.0
    low, high = np.maximum(boxes[nearer, :2], boxes[n, :2]), np.minimum(boxes[nearer, 2:], boxes[n, 2:])
    return float(np.prod(np.maximum(high - low, 0.0), axis=1).max() / max(_areas(boxes[n : n + 1])[0], 1e-9))


def _areas(boxes: Array) -> Array:
    return np.asarray(np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0), axis=1))


def _clipped(boxes: Array) -> Array:
    return np.asarray(np.clip(boxes, 0.0, [CAMERA.width, CAMERA.height, CAMERA.width, CAMERA.height]))


def _name(name: str, office: Office, random: np.random.Generator) -> str:
    if random.random() >= office.confused:
        return name
    return str(random.choice([other for other in (*KINDS, *OTHERS) if other != name]))


def _alarm(random: np.random.Generator) -> Array:
    """(4,) anywhere in the picture."""
    half = random.uniform(15.0, 80.0, 2)
    middle = random.uniform(half, [CAMERA.width, CAMERA.height] - half)
    return np.concatenate([middle - half, middle + half])
