"""State of a live run for the page, in bounded memory; written by one thread, read by many."""

import secrets
import threading
import time
from collections import Counter
from typing import Any

import numpy as np

from semantic_slam.evaluation.record import json_object
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.evidence.model_fit import UNEXPLAINED
from semantic_slam.inference.inputs.spatial_reader import camera_of
from semantic_slam.inference.models.spatial.camera import Camera
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.messages.ground_truth import GroundTruthObjects, ReplayProgress
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.report.drawing.palette import OTHER_COLOUR
from semantic_slam.report.plain_json import plain
from semantic_slam.report.shown.keyframe import rounded
from semantic_slam.report.shown.space import camera_pyramid
from semantic_slam.view.class_palette import ClassPalette
from semantic_slam.view.extent import Extent
from semantic_slam.view.live_charts import LiveCharts
from semantic_slam.view.node_health import NodeHealth
from semantic_slam.view.pictures import Pictures
from semantic_slam.view.timeline import Timeline
from semantic_slam.view.true_path import TruePath


class LiveRun:
    """The newest run; its ``session`` is another one as soon as another run begins, or the view anew."""

    def __init__(self, topic: str = "", namespace: str = "/") -> None:
        """``topic``: the belief's, ``namespace``: that of the nodes."""
        self.health = NodeHealth(namespace)
        self.refused: Counter[str] = Counter()  # messages that could not be used, by kind
        self.publishers = 0  # of the belief
        self.topic = topic
        self._lock = threading.Lock()
        self._token = secrets.token_hex(4)
        self._number = 0
        self._version = 0
        self._configuration: RunConfiguration | None = None
        self._pictures = Pictures()
        self._true_path = TruePath()
        self._true_objects: list[list[float]] = []
        self._begin(0)

    def _begin(self, stamp_ns: int) -> None:
        """Forget one run for another, whose first keyframe is of that time."""
        self._number += 1
        self._run_id: str | None = None  # not known yet
        self._first_stamp_ns: int | None = None  # of keyframe 0, where that was seen
        self._has_ended = False
        self._repeated: int | None = None
        self._missed = 0
        self._came_s: float | None = None
        self._timeline = Timeline()
        self._extent = Extent()
        self._palette = ClassPalette()
        self._classes: list[dict[str, Any]] = []
        self._charts = LiveCharts()
        self._camera = Camera()
        self._pyramid: list[list[float]] = []  # what it sees, of a run in space
        self._pictures.forget_run()
        self._true_path.begin(stamp_ns)

    @property
    def session(self) -> str:
        return f"{self._token}.{self._number}"

    def add_configuration(self, run: RunConfiguration) -> None:
        """Take in what is said of the run that is going on, or of one that begins."""
        with self._lock:
            if self._run_id not in (None, run.run_id):
                self._begin(run.stamp_ns)
            self._run_id, self._configuration = run.run_id, run

    def add_progress(self, progress: ReplayProgress) -> None:
        with self._lock:
            self._has_ended |= progress.finished and bool(self._timeline.moments)

    def add_belief(self, belief: HybridBelief) -> None:
        """The next keyframe's, or one that is known, or the first of another run."""
        with self._lock:
            if self._is_of_another_run(belief):
                self._begin(belief.stamp_ns)
            if belief.keyframe <= self._timeline.newest:
                self._repeated = belief.keyframe
                return
            self._take_in(belief)

    def _is_of_another_run(self, belief: HybridBelief) -> bool:
        timeline, keyframe = self._timeline, belief.keyframe
        if keyframe > timeline.newest:
            return False
        if keyframe == 0 and (self._has_ended or belief.stamp_ns != self._first_stamp_ns):
            return True
        return keyframe >= timeline.oldest and not timeline.has(belief)

    def _take_in(self, belief: HybridBelief) -> None:
        self._version += 1
        self._came_s, self._repeated = time.monotonic(), None
        if belief.keyframe == 0:
            self._first_stamp_ns = belief.stamp_ns
        if self._timeline.moments:
            self._missed += belief.keyframe - self._timeline.newest - 1
        self._timeline.add(belief, self._version)
        colours = self._palette.of(belief)
        pairs = zip(belief.class_names, colours, strict=True)
        self._classes = [{"name": name, "colour": own, "shared": own == OTHER_COLOUR} for name, own in pairs]
        self._pyramid = [] if belief.planar else self._seen_by_the_camera()
        true_objects = np.array(self._true_objects).reshape(-1, 3)[:, :2]
        self._extent.show(np.concatenate([self._timeline.to_be_seen(), true_objects]))
        self._pictures.add_belief(belief, colours, self._version, self._folder)
        self._charts.add(belief)

    def _seen_by_the_camera(self) -> list[list[float]]:
        run = self._configuration
        settings = json_object(run.configuration).get("open_world", {}) if run else {}
        return [rounded(point) for point in camera_pyramid(self._camera, settings)]

    @property
    def _folder(self) -> str:
        return f"pictures/{self.session}"

    def add_measurements(self, measured: SemanticMeasurements) -> None:
        with self._lock:
            self._version += 1
            self._camera = camera_of(measured)
            self._pictures.add_measurements(measured, self._version, self._folder)

    def add_picture(self, message: Any) -> None:
        """A sensor_msgs Image or CompressedImage."""
        with self._lock:
            self._version += 1
            self._pictures.add_picture(message, self._version, self._folder)

    def add_true_pose(self, pose: OdometryEstimate) -> None:
        with self._lock:
            self._version += 1
            self._true_path.add(pose, self._version)

    def add_true_objects(self, objects: GroundTruthObjects) -> None:
        with self._lock:
            poses = objects.poses[~objects.moves, :3]
            self._true_objects = poses[np.isfinite(poses).all(axis=1)].round(3).tolist()

    def add_diagnostics(self, message: Any) -> None:
        with self._lock:
            self.health.add(message)

    def changes(self, session: str, version: int) -> dict[str, Any]:
        """What a page has to learn that knows all up to ``version`` of a session; all there is for another session."""
        with self._lock:
            since = version if session == self.session else 0
            frames = self._timeline.changed_since(since)
            found = {
                "session": self.session,
                "version": self._version,
                "first": self._timeline.oldest,
                "objects": self._timeline.objects.changed_since(since),
                "pictures": self._pictures.changed_since(since),
                "truth": self._true_path.changed_since(since),
                "crosses": self._true_objects,
                "camera": self._pyramid or None,
                "classes": self._classes,
                "extent": self._extent.box,
                "run": self._run(),
                "state": self._state(),
                "health": self.health.rows(),
                "dropped": self.health.dropped() + self._refused(),
            }
        return {**plain(found), "frames": frames}

    def _run(self) -> dict[str, str]:
        run = self._configuration
        if run is None:
            return {"id": "", "source": "", "revision": ""}
        source = str(json_object(run.source).get("path") or "")
        return {"id": run.run_id, "source": source, "revision": run.revision}

    def _state(self) -> dict[str, Any]:
        unexplained = self._timeline.moments[-1].scene["unexplained"] if self._timeline.moments else 0.0
        return {
            "topic": self.topic,
            "publishers": self.publishers,
            "age": None if self._came_s is None else round(time.monotonic() - self._came_s, 1),
            "ended": self._has_ended,
            "repeated": self._repeated,
            "missed": self._missed,
            "lost": None if unexplained is None else unexplained > UNEXPLAINED,  # None: not known
        }

    def _refused(self) -> list[list[str]]:
        return [["view", reason, str(count)] for reason, count in sorted(self.refused.items())]

    def charts(self) -> dict[str, Any]:
        """Keyframes and HTML of the charts."""
        with self._lock:
            charts, beliefs = self._charts, self._charts.beliefs
        return charts.draw(beliefs)

    def picture(self, session: str, keyframe: int) -> bytes | None:
        """JPEG of a keyframe; None where there is none. Raises MessageError where it does not decode."""
        with self._lock:
            found = self._pictures.shown.get(keyframe) if session == self.session else None
        return found.jpeg if found is not None else None
