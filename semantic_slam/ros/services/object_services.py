"""Services ``~/find_objects``, ``~/get_object`` and ``~/query_place`` of the hypothesis manager."""

from typing import Any

import numpy as np
from rclpy.node import Node
from semantic_slam_msgs.srv import FindObjects, GetObject, QueryPlace

from semantic_slam.answers.find_objects import find_objects
from semantic_slam.answers.get_object import get_object
from semantic_slam.answers.query_place import query_place
from semantic_slam.answers.question import Question
from semantic_slam.answers.region import Region
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.ros.services.answering import answering, newest


class ObjectServices:
    """Answers from the attribute ``belief``, the newest one."""

    def __init__(self, node: Node) -> None:
        self.belief: HybridBelief | None = None
        self.map_prior: MapPrior | None = None  # of the run that the belief belongs to
        self._services = [
            node.create_service(FindObjects, "~/find_objects", answering(self._find)),
            node.create_service(GetObject, "~/get_object", answering(self._get)),
            node.create_service(QueryPlace, "~/query_place", answering(self._query)),
        ]

    def _find(self, request: Any, response: Any) -> None:
        belief = newest(self.belief)
        found = find_objects(belief, _question(request))
        response.keyframe = belief.keyframe
        response.object_ids = [own.object_id for own in found.objects]
        response.object_names = [own.name for own in found.objects]
        response.probabilities = [own.probability for own in found.objects]
        response.poses = _flat([own.pose for own in found.objects])
        response.covariances = _flat([own.covariance for own in found.objects])
        response.unknown = found.unknown

    def _get(self, request: Any, response: Any) -> None:
        belief = newest(self.belief)
        known = get_object(belief, int(request.object_id))
        response.keyframe = belief.keyframe
        response.pose, response.covariance = _flat([known.pose]), _flat([known.covariance])
        response.class_names = list(known.class_probabilities)
        response.class_probabilities = list(known.class_probabilities.values())
        for name in ("name", "existence", "moving", "moved", "missing", "mutual_information", "in_coverage"):
            setattr(response, name, getattr(known, name))

    def _query(self, request: Any, response: Any) -> None:
        belief = newest(self.belief)
        placed = query_place(belief, _region(request), request.least_probability, self.map_prior)
        response.keyframe = belief.keyframe
        response.object_ids = [own.object_id for own in placed]
        response.object_names = [own.name for own in placed]
        response.here, response.gone = [own.here for own in placed], [own.gone for own in placed]
        response.poses = _flat([own.pose for own in placed])
        response.covariances = _flat([own.covariance for own in placed])


def _question(request: Any) -> Question:
    return Question(name=request.name, region=_region(request), least_probability=request.least_probability)


def _region(request: Any) -> Region | None:
    region = tuple(request.region)
    if len(region) not in (0, 4):
        raise InputError(f"region has {len(region)} numbers; give x_min y_min x_max y_max, or none for everywhere")
    return region or None


def _flat(rows: list[Array]) -> list[float]:
    return [float(value) for row in rows for value in np.ravel(row)]
