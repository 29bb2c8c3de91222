"""Edges of boxes that something nearer cuts: their objects go on there, as beyond the border of the image."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from scipy.stats import chi2

from semantic_slam import Engine, HybridBelief
from semantic_slam.configuration import load_configuration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.perception import classifier as classifier_module
from semantic_slam.perception.classifier import Classifier
from semantic_slam.perception.cut_edges import cut_by_border, cut_edges
from semantic_slam.perception.frame import CameraModel, Detections, Frame
from semantic_slam.perception.range_bearing import range_and_bearing
from semantic_slam.shipped import configuration_file

CAMERA = CameraModel(320, 240, 250.0, 250.0, 160.0, 120.0)
AHEAD = np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5])
SETTINGS = load_configuration(configuration_file("spatial")).perception
FAR_M = 5.0
NOTHING = [[False, False], [False, False]]
LEFT, RIGHT, BELOW = ([[True, False], [False, False]], [[False, True], [False, False]], [[False, False], [False, True]])


def painted(*surfaces: tuple[Sequence[float], float]) -> np.ndarray:
    """A depth image of boxes (4,) at depths [m], the later before the earlier, on a wall."""
    depth = np.full((CAMERA.height, CAMERA.width), FAR_M, dtype=np.float32)
    for box, depth_m in surfaces:
        low_x, low_y, high_x, high_y = np.clip(np.round(box).astype(int), 0, None)
        depth[low_y:high_y, low_x:high_x] = depth_m
    return depth


THING, WIDE = [100.0, 80.0, 140.0, 160.0], [60.0, 40.0, 220.0, 180.0]
BESIDE, LOWER = [140.0, 40.0, 200.0, 190.0], [140.0, 90.0, 200.0, 150.0]


@pytest.mark.parametrize(
    ("boxes", "depths", "wanted"),
    [
        pytest.param([THING, BESIDE], [2.0, 1.0], [RIGHT, NOTHING], id="a nearer thing abuts"),
        pytest.param([THING, BESIDE], [2.0, 1.95], [NOTHING, NOTHING], id="as near, side by side"),
        pytest.param([THING, LOWER], [1.0, 2.0], [NOTHING, LEFT], id="the farther is the one that is cut"),
        pytest.param([THING, WIDE], [1.0, 2.0], [NOTHING, NOTHING], id="a cup before a monitor"),
        pytest.param([THING, [99.0, 81.0, 141.0, 158.0]], [2.0, 2.0], [NOTHING, NOTHING], id="one thing, two labels"),
        pytest.param([THING, [140.0, 60.0, 200.0, 110.0]], [2.0, 1.0], [NOTHING, NOTHING], id="a third of an edge"),
    ],
)
def test_by_depth_the_farther_of_two_things_is_cut_along_most_of_an_edge(
    boxes: list[list[float]], depths: list[float], wanted: list[list[list[bool]]]
) -> None:
    surfaces = sorted(zip(boxes, depths, strict=True), key=lambda surface: -surface[1])
    assert cut_edges(np.array(boxes), CAMERA, painted(*surfaces)).tolist() == wanted


def test_a_surface_of_no_detection_cuts_what_is_behind_it_but_not_what_stands_on_it() -> None:
    """A table that hides the lower half of a chair; and one upon which a cup stands, whose top reaches its base."""
    behind = painted((THING, 2.5), ([0.0, 160.0, 320.0, 240.0], 1.2))
    assert cut_edges(np.array([THING]), CAMERA, behind).tolist() == [BELOW]
    row = np.arange(160, 240)
    upon = painted((THING, 2.0))
    upon[160:] = (2.0 * (160.0 - 110.0) / (row - 110.0))[:, None]  # level, 0.4 m below the camera, horizon at 110
    assert cut_edges(np.array([THING]), CAMERA, upon).tolist() == [NOTHING]


@pytest.mark.parametrize(("width_m", "height_m", "away_m", "above_m"), [(0.5, 0.9, 4.0, 1.2), (0.7, 1.7, 4.5, 1.4)])
def test_a_box_that_ends_a_little_beside_the_thing_is_seldom_cut_by_the_floor(
    width_m: float, height_m: float, away_m: float, above_m: float
) -> None:
    """Edges err by 5 % of their side; below the foot of a chair or a fridge the floor comes nearer and nearer."""
    rows = np.arange(CAMERA.height)
    with np.errstate(divide="ignore"):
        floor = np.where(rows > CAMERA.cy, above_m * CAMERA.fy / (rows - CAMERA.cy), FAR_M)
    depth = np.repeat(np.minimum(floor, FAR_M)[:, None], CAMERA.width, axis=1).astype(np.float32)
    high, low = above_m - height_m, above_m  # below the optical axis
    ends = np.array([[-0.5 * width_m, high], [0.5 * width_m, low]]) * CAMERA.fy / away_m + [CAMERA.cx, CAMERA.cy]
    (left, top), (right, bottom) = np.round(ends).astype(int)
    depth[top:bottom, left:right] = away_m
    box = np.array([left, top, right, bottom], dtype=np.float64)
    sides = np.tile(box[2:] - box[:2], 2)
    boxes = box + 0.05 * sides * np.random.default_rng(0).normal(size=(400, 4))
    assert cut_edges(boxes, CAMERA, depth)[:, 1, 1].mean() < 0.06


def detections(boxes: Sequence[Sequence[float]] | np.ndarray) -> Detections:
    names = ("cup", "book", "bottle")[: len(boxes)]
    ones = np.ones(len(boxes))
    return Detections(
        stamp_ns=1, frame_id="", boxes=np.array(boxes), labels=names, scores=ones, track_ids=("",) * len(boxes)
    )


def in_space(labels: tuple[str, ...] = ()) -> Classifier:
    """Of boxes with depth, of which only these labels are used, where there are any."""
    settings = replace(SETTINGS, labels=labels)
    sensor = partial(range_and_bearing, configuration=settings)
    return Classifier(None, settings, seed=0, range_bearing_sensor=sensor, in_space=True)


def frame_of(boxes: Sequence[Sequence[float]], depths: Sequence[float], camera: CameraModel = CAMERA) -> Frame:
    surfaces = zip(boxes, depths, strict=True)
    return Frame(1, np.zeros((240, 320, 3), np.uint8), painted(*surfaces), camera, detections(boxes))


def test_what_a_thing_cuts_is_stated_as_what_the_border_cuts() -> None:
    """The same box at the left border, and as far off the optical axis at the right edge of a nearer thing."""
    cut = in_space().measure(frame_of([[0.0, 80.0, 40.0, 160.0]], [2.0]), 0, AHEAD)
    shifted = replace(CAMERA, cx=CAMERA.cx + 100.0)
    boxes = [[100.0, 80.0, 140.0, 160.0], [40.0, 60.0, 100.0, 180.0]]
    hidden = in_space().measure(frame_of(boxes, [2.0, 1.0], shifted), 0, AHEAD)
    for name in ("bearings_rad", "elevations_rad", "points", "point_covariances", "angular_sizes_rad"):
        np.testing.assert_allclose(getattr(hidden, name)[0], getattr(cut, name)[0], rtol=1e-9, atol=1e-9)
    assert np.isnan(cut.angular_sizes_rad[0]).tolist() == [True, False]


def test_things_that_are_not_used_hide_others_too() -> None:
    found = in_space(("cup",)).measure(frame_of([THING, BESIDE], [2.0, 1.0]), 0, AHEAD)
    assert found.labels == ("cup",) and np.isnan(found.angular_sizes_rad[0]).tolist() == [True, False]


@dataclass(frozen=True)
class Scene:
    """A thing and a nearer one that hides a part of it, as upright rectangles across the optical axis."""

    centres: np.ndarray  # (2, 3) x ahead, y left, z up
    halves: np.ndarray  # (2, 2) half width and height

    @classmethod
    def drawn(cls, random: np.random.Generator) -> "Scene":
        """Up to two thirds of the width of the farther thing are hidden, from either side."""
        halves = np.array([random.uniform(0.12, 0.2, 2), [0.2, 0.3]])
        far, near = random.uniform(2.2, 3.0), random.uniform(1.0, 1.5)
        y, side = random.uniform(-0.3, 0.3), random.choice([-1.0, 1.0])
        edge = y + side * halves[0, 0] * (1.0 - 2.0 * random.uniform(0.15, 0.66))
        return cls(np.array([[far, y, 0.0], [near, edge * near / far + side * halves[1, 0], 0.0]]), halves)

    def seen(self, place: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """(240, 320) depth from a place (3,), and (2, 4) boxes of what shows, whose edges err by 2 % and a pixel."""
        away = self.centres - place
        depth = np.full((CAMERA.height, CAMERA.width), FAR_M)
        owner = np.full(depth.shape, -1)
        for n, ((x, y, z), (half_width, half_height)) in enumerate(zip(away, self.halves, strict=True)):
            u = CAMERA.cx - CAMERA.fx * np.array([y + half_width, y - half_width]) / x
            v = CAMERA.cy - CAMERA.fy * np.array([z + half_height, z - half_height]) / x
            (left, right), (top, bottom) = (np.clip(np.round(ends).astype(int), 0, None) for ends in (u, v))
            depth[top:bottom, left:right], owner[top:bottom, left:right] = x, n
        boxes = np.empty((2, 4))
        for n in range(2):
            rows, columns = np.nonzero(owner == n)
            box = np.array([columns.min(), rows.min(), columns.max() + 1.0, rows.max() + 1.0])
            sides = np.tile(box[2:] - box[:2], 2)
            boxes[n] = box + np.hypot(1.0, 0.02 * sides) * random.normal(size=4)
        noise = 1.0 + 0.005 * random.normal(size=depth.shape)
        return (depth * noise).astype(np.float32), np.clip(boxes, 0.0, [320.0, 240.0] * 2)


def mapped(scene: Scene, random: np.random.Generator, keyframes: int = 4) -> HybridBelief:
    """The belief after moving ahead and aside, with depth."""
    shipped = load_configuration(configuration_file("spatial"))
    configuration = replace(shipped, semantic_model=replace(shipped.semantic_model, labels=("cup", "book")))
    perception = replace(configuration.perception, depth_to_width=0.0)
    sensor = partial(range_and_bearing, configuration=perception)
    classifier = Classifier(None, perception, seed=0, range_bearing_sensor=sensor, in_space=True)
    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    engine = Engine(configuration, initial_pose=start, initial_covariance=1e-8 * np.eye(6))
    step = np.array([0.02, 0.004, 0.0])
    for k in range(keyframes):
        depth, boxes = scene.seen(k * step, random)
        frame = Frame((k + 1) * 10**9, np.zeros((240, 320, 3), np.uint8), depth, CAMERA, detections(boxes))
        motion = np.append(step if k else np.zeros(3), start[3:])
        measured = classifier.measure(frame, k, AHEAD)
        belief = engine.process(
            Keyframe(
                index=k,
                stamp_ns=frame.stamp_ns,
                odometry=motion,
                odometry_covariance=1e-8 * np.eye(6),
                measurements=measured,
            )
        )
    return belief


def errors_of(rule: Callable[..., np.ndarray], monkeypatch: pytest.MonkeyPatch) -> tuple[np.ndarray, np.ndarray]:
    """(R,) errors [m] and normalised squared errors of hidden things in many scenes; ``rule`` says what is cut."""
    monkeypatch.setattr(classifier_module, "cut_edges", rule)
    errors, squares = [], []
    for seed in range(10):
        random = np.random.default_rng(seed)
        scene = Scene.drawn(random)
        objects, place = mapped(scene, random).objects, scene.centres[0]
        known = objects[int(np.argmin([np.linalg.norm(item.position - place) for item in objects]))]
        off = known.position - place
        errors.append(float(np.linalg.norm(off)))
        squares.append(float(off @ np.linalg.solve(known.covariance[:3, :3], off)))
    return np.array(errors), np.array(squares)


@pytest.mark.long
def test_half_hidden_things_are_where_they_are_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """Taken at face value, the middles of what shows are sure of places that are not those of the things."""
    errors, squares = errors_of(cut_edges, monkeypatch)
    errors_before, squares_before = errors_of(lambda boxes, camera, *_: cut_by_border(boxes, camera), monkeypatch)
    assert squares.mean() < chi2.ppf(0.975, 3 * len(squares)) / len(squares) < squares_before.mean()
    assert np.sqrt(np.mean(errors**2)) < np.sqrt(np.mean(errors_before**2))
