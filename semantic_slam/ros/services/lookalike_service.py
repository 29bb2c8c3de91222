"""Service ``~/find_lookalike`` of the hypothesis manager."""

from typing import TYPE_CHECKING, Any

import numpy as np
from semantic_slam_msgs.srv import FindLookalike

from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.ros.services.answering import answering
from semantic_slam.ros.services.belief_service import BeliefService
from semantic_slam.ros.services.in_background import InBackground

if TYPE_CHECKING:
    from semantic_slam.pipeline.lookalike_query import LookalikeQuery


class LookalikeService(BeliefService):
    """Answers from the newest belief; runs in the background because the network is slow."""

    def __init__(self, background: InBackground, settings: SemanticModelConfiguration) -> None:
        super().__init__()
        self._settings = settings
        self._query: LookalikeQuery | None = None
        self._service = background.create_service(FindLookalike, "~/find_lookalike", answering(self._fill))

    @property
    def _questions(self) -> "LookalikeQuery":
        """The query, created with the first request, so that the network's library is not loaded without need."""
        from semantic_slam.pipeline.lookalike_query import LookalikeQuery

        if self._query is None:
            self._query = LookalikeQuery(self._settings)
        return self._query

    def _fill(self, request: Any, response: Any) -> None:
        belief = self.newest().belief
        if len(request.box) not in (0, 4):
            raise InputError(f"box has {len(request.box)} numbers; give four, or none for the whole picture")
        box = np.array(request.box, dtype=np.float64) if len(request.box) else None
        from semantic_slam.pipeline.lookalike_query import picture

        found = self._questions.ask(belief, picture(bytes(request.image), "image"), box)
        rows = found.ranking()
        response.keyframe = belief.keyframe
        response.object_ids = belief.object_ids[rows].tolist()
        response.object_names = [belief.object_names[row] for row in rows]
        response.probabilities = found.probabilities[rows].tolist()
        response.azimuths = found.azimuth_rad[rows].tolist()
        response.unknown = found.unknown
