"""Service ``~/find_lookalike`` of the hypothesis manager."""

from typing import Any

import numpy as np
from rclpy.node import Node
from semantic_slam_msgs.srv import FindLookalike

from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.pipeline.lookalike_query import LookalikeQuery, picture


class LookalikeService:
    """Answers from the newest belief that it was told of."""

    def __init__(self, node: Node, settings: SemanticModelConfiguration) -> None:
        self.belief: HybridBelief | None = None
        self._query = LookalikeQuery(settings)
        self._service = node.create_service(FindLookalike, "~/find_lookalike", self._answer)

    def _answer(self, request: Any, response: Any) -> Any:
        try:
            self._fill(request, response)
        except InputError as fault:
            response.fault = str(fault)
        return response

    def _fill(self, request: Any, response: Any) -> None:
        belief = self.belief
        if belief is None:
            raise InputError("there is no belief yet; ask after the first keyframe")
        if len(request.box) not in (0, 4):
            raise InputError(f"box has {len(request.box)} numbers; give four, or none for the whole picture")
        box = np.array(request.box, dtype=np.float64) if len(request.box) else None
        found = self._query.ask(belief, picture(bytes(request.image), "image"), box)
        rows = found.ranking()
        response.keyframe = belief.keyframe
        response.object_ids = belief.object_ids[rows].tolist()
        response.object_names = [belief.object_names[row] for row in rows]
        response.probabilities = found.probabilities[rows].tolist()
        response.azimuths = found.azimuth_rad[rows].tolist()
        response.unknown = found.unknown
