"""Services ``~/find_objects``, ``~/get_object`` and ``~/query_place`` of the hypothesis manager."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from rclpy.node import Node
from semantic_slam_msgs.srv import FindObjects, GetObject, QueryPlace

from semantic_slam.answers.appearance_history import AppearanceHistory
from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.get_object import get_object
from semantic_slam.answers.query_place import query_place
from semantic_slam.answers.question import MAPPED, Question
from semantic_slam.answers.region import Region
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.ros.services.answering import answering
from semantic_slam.ros.services.belief_service import BeliefService, BeliefUpdate
from semantic_slam.ros.services.in_background import InBackground


class ObjectServices(BeliefService):
    """Answers from the newest belief and the appearances of the run so far.

    Objects are found in the background, because a question by vector compares all vectors of the run.
    """

    def __init__(self, node: Node, background: InBackground, settings: SemanticModelConfiguration) -> None:
        super().__init__()
        self._settings, self._history = settings, AppearanceHistory(settings)
        self._services = [
            background.create_service(FindObjects, "~/find_objects", answering(self._find)),
            node.create_service(GetObject, "~/get_object", answering(self._get)),
            node.create_service(QueryPlace, "~/query_place", answering(self._query)),
        ]

    def begin(self) -> None:
        """Start another run: forget the belief and what its objects look like."""
        super().begin()
        self._history = AppearanceHistory(self._settings)

    def update(self, update: BeliefUpdate) -> None:
        """Set the newest belief, and add its keyframe's measurements to the appearances."""
        super().update(update)
        self._history.add(update.belief, update.measurements)

    def _find(self, request: Any, response: Any) -> None:
        belief, history, question = self.newest().belief, self._history, _question(request)
        needs_looks = question.vector is not None or bool(question.text_vectors)
        found = find_objects(belief, question, history.appearances() if needs_looks else None)
        response.keyframe = belief.keyframe
        response.object_ids = [own.object_id for own in found.objects]
        response.object_names = [own.name for own in found.objects]
        response.probabilities = [own.probability for own in found.objects]
        response.poses = _flat([own.pose for own in found.objects])
        response.covariances = _flat([own.covariance for own in found.objects])
        response.unknown = found.unknown

    def _get(self, request: Any, response: Any) -> None:
        belief = self.newest().belief
        known = get_object(belief, int(request.object_id))
        response.keyframe = belief.keyframe
        response.pose, response.covariance = _flat([known.pose]), _flat([known.covariance])
        response.class_names = list(known.class_probabilities)
        response.class_probabilities = list(known.class_probabilities.values())
        for name in ("name", "existence", "moving", "moved", "missing", "mutual_information", "in_coverage"):
            setattr(response, name, getattr(known, name))

    def _query(self, request: Any, response: Any) -> None:
        newest = self.newest()
        belief = newest.belief
        placed = query_place(belief, _region(request), request.least_probability, newest.map_prior)
        response.keyframe = belief.keyframe
        response.object_ids = [own.object_id for own in placed]
        response.object_names = [own.name for own in placed]
        response.here, response.gone = [own.here for own in placed], [own.gone for own in placed]
        response.poses = _flat([own.pose for own in placed])
        response.covariances = _flat([own.covariance for own in placed])


def _question(request: Any) -> Question:
    return Question(
        name=request.name,
        vector=np.array(request.vector) if len(request.vector) else None,
        text_vectors=_text_vectors(request),
        region=_region(request),
        least_probability=request.least_probability,
        mapped=request.mapped if request.mapped != 0.0 else MAPPED,
    )


def _text_vectors(request: Any) -> Mapping[str, Array]:
    """Name -> (F,) of the named text vectors. Raises InputError where names and numbers do not go together."""
    names, numbers = list(request.text_names), np.array(request.text_vectors, dtype=np.float64)
    if not names and not len(numbers):
        return {}
    if len(set(names)) != len(names):
        raise InputError("a name of text_names is given twice; give each once")
    if not names or not len(numbers) or len(numbers) % len(names):
        raise InputError(
            f"text_vectors has {len(numbers)} numbers for {len(names)} text_names; give a row of equal length for each"
        )
    return dict(zip(names, numbers.reshape(len(names), -1), strict=True))


def _region(request: Any) -> Region | None:
    region = tuple(request.region)
    if len(region) not in (0, 4):
        raise InputError(f"region has {len(region)} numbers; give x_min y_min x_max y_max, or none for everywhere")
    return region or None


def _flat(rows: list[Array]) -> list[float]:
    return [float(value) for row in rows for value in np.ravel(row)]
