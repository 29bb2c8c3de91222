"""Marginals that Cholesky cannot give are read by QR of the whole graph, and are the same where both work."""

import numpy as np

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.keys import object_key, robot_key


def test_marginals_by_qr_are_those_of_the_solver() -> None:
    engine = Engine(Configuration.of(association="open", semantic_model={"kind": "none"}))
    for number in range(4):
        seen = [Detection.at(3.0 - 0.5 * number, 0.1), Detection.at(2.5 - 0.5 * number, -0.4)]
        engine.process(Keyframe.planar(number, motion=(0.5, 0.0, 0.0), detections=seen))
    assert isinstance(engine.pool, InProcessPool)
    component = engine.pool.component(next(iter(engine.live)))
    reader = component.smoother._marginals
    keys = [robot_key(3), *(object_key(int(number)) for number in component.objects.ids)]
    assert len(keys) > 1
    np.testing.assert_allclose(reader._by_qr(keys), reader._read(keys), rtol=1e-6, atol=1e-9)
