"""Service ``~/save_map`` of the hypothesis manager."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.node import Node
from semantic_slam_msgs.srv import SaveMap

from semantic_slam.errors import InputError
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.outputs import claimed_file
from semantic_slam.ros.services.answering import answering
from semantic_slam.ros.services.belief_service import BeliefService

LEAVE = "overwrite: true"


class MapService(BeliefService):
    """Writes the map of the newest belief while the run continues.

    Only each object's marginal is saved: correlations between objects are known to the backends alone, and
    ``semantic_slam map save`` obtains them from a recorded belief bag.
    """

    def __init__(self, node: Node, run: Callable[[], RunConfiguration]) -> None:
        super().__init__()
        self._run = run  # returns the configuration of the run that the belief belongs to
        self._service = node.create_service(SaveMap, "~/save_map", answering(self._save))

    def _save(self, request: Any, response: Any) -> None:
        from semantic_slam.maps.from_belief import saved_map_of_belief
        from semantic_slam.maps.map_file import write_map

        belief = self.newest().belief
        if not request.path:
            raise InputError("path is empty; name a FILE.map on the manager's machine")
        place, saved = Path(request.path), saved_map_of_belief(belief, self._run())
        try:
            with claimed_file(place, (), request.overwrite, LEAVE) as out:
                known = write_map(out, saved)
        except OSError as fault:
            raise InputError(f"{place}: {fault.strerror}; name a place that can be written to") from None
        response.keyframe, response.map_id, response.objects = belief.keyframe, known.map_id, len(known.objects)
