"""Runs whose root hypotheses differ in the noise that they assume: what is left of each root."""

import numpy as np
from worlds.drives.open_room import Room

from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool


def engine_after(room: Room) -> Engine:
    """The engine after all keyframes of a room."""
    engine = Engine.of_run(room.run, InProcessPool(1))
    for keyframe in room.keyframes:
        engine.process(keyframe)
    return engine


def weights_of_roots(engine: Engine, count: int) -> np.ndarray:
    """(count,) weights of the live hypotheses that began at each root."""
    weights = np.zeros(count)
    for live in engine.live.values():
        weights[live.lineage[0].mode] += np.exp(live.log_weight)
    return weights
