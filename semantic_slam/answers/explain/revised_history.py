"""Replay of a history that was revised, or located on the map later, in its final form from the start."""

from collections.abc import Mapping, Sequence

from semantic_slam.answers.explain.live_history import LiveHistory, object_of
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.revision.replay import Replay
from semantic_slam.inference.states.lineage import Lineage


def replayed_history(
    engine: Engine, lineage: Lineage, names: Mapping[int, Sequence[int]], log_prior: Mapping[int, Array]
) -> tuple[LiveHistory, ...]:
    """(K,) states that a hypothesis would have had after every keyframe, had its final history held from the start.

    ``names``: object id -> ids under which the hypothesis may hold it.
    """
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry), engine.steps)
    own, found = replay.begun(lineage), list[LiveHistory]()
    for step in lineage:
        before = own.number
        own = replay.advanced(own, 1)
        component = own.component
        found.append(
            LiveHistory(
                parent_id=before,
                log_weight=0.0,
                history=0,
                association=step.association,
                is_revised=False,
                changes=(),
                pose=engine.problem.spaces.robot.poses(component.newest_robot()[None])[0],
                objects={n: object_of(component, alias, log_prior[n]) for n, alias in names.items()},
            )
        )
    return tuple(found)
