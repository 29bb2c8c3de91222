"""Which object of a map a track id means."""

import json
from collections.abc import Mapping

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe, MapPrior, ObjectPrior
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.identities import objects_by_identity
from semantic_slam.inference.world.map_prior import parse_map_prior

PLACES = {"7": (2.0, 0.0), "0": (3.0, 1.0), "2": (3.0, -1.0)}
"""Places in map [m] by track id, in the order in which they are seen first."""


@pytest.mark.parametrize(
    ("names", "meant"),
    [
        ({0: "3", 1: "2", 2: "1"}, {"3": 0, "2": 1, "1": 2}),  # a tracker's numbers: ids 0 and 1 mean nothing
        ({0: "7", 1: "moving/9"}, {"7": 0, "moving/9": 1}),
        ({0: "0", 5: "5"}, {"0": 0, "5": 5}),  # as a map without names is read
        ({4: "object_4", 6: "object_6"}, {"4": 4, "object_4": 4, "6": 6, "object_6": 6}),
        ({4: "by the door"}, {"4": 4, "by the door": 4}),
        ({4: "object_4", 6: "12"}, {"4": 4, "object_4": 4, "12": 6}),  # surveyed, then extended by a tracker
    ],
)
def test_names_come_before_numbers_and_a_trackers_numbers_leave_no_meaning_to_ids(
    names: Mapping[int, str], meant: dict[str, int]
) -> None:
    assert objects_by_identity(names) == meant


@pytest.mark.parametrize("iterated", [True, False])
def test_a_second_session_with_a_trackers_numbers_meets_the_same_objects(iterated: bool) -> None:
    first = _run(PLACES, MapPrior(), iterated)
    assert first.object_names == tuple(PLACES)
    second = _run(PLACES, _map_of(first), iterated)
    assert second.object_names == first.object_names and second.hypotheses[0].associations == (0, 1, 2)
    assert second.unexplained < 0.5
    np.testing.assert_allclose(second.hypotheses[0].position[:2], [0.2, 0.0], atol=0.05)
    moved_on = {"7": PLACES["7"], "1": (4.0, 0.5)}  # a track id that is an object's number and no object's name
    assert _run(moved_on, _map_of(first), iterated).object_names == (*PLACES, "1")


def test_a_map_written_with_numbers_alone_is_met_under_its_numbers() -> None:
    rows = [
        {"id": n, "pose": [*PLACES[str(n)], 0, 0, 0, 0, 1], "covariance": np.diag([0.0025] * 6).tolist()}
        for n in (7, 0, 2)
    ]
    written = parse_map_prior(json.dumps({"objects": rows}), "by hand")
    best = _run(PLACES, written).hypotheses[0]
    assert best.associations == (7, 0, 2)
    np.testing.assert_allclose(best.position[:2], [0.2, 0.0], atol=0.05)


def _map_of(belief: HybridBelief) -> MapPrior:
    rows = zip(belief.object_ids.tolist(), belief.object_poses[:, :2].tolist(), belief.object_names, strict=True)
    return MapPrior(tuple(ObjectPrior.planar(n, *at, sigma_m=0.05, sigma_rad=0.1, name=name) for n, at, name in rows))


def _run(places: Mapping[str, tuple[float, float]], known: MapPrior, iterated: bool = True) -> HybridBelief:
    """Last belief of a robot that starts near the origin, moves 0.2 m and sees all ``places`` under their track ids."""
    settings = {"association": "given", "semantic_model": {"kind": "none"}}
    configuration = Configuration.of(**settings, open_world={"iterate_updates": iterated})
    engine = Engine(
        configuration, known, initial_pose=(0.0, 0.0, 0.0), initial_covariance=np.diag([0.1, 0.1, 0.05]) ** 2
    )
    for k in range(3):
        seen = [Detection.at(x - 0.1 * k, y, track_id=name) for name, (x, y) in places.items()]
        moved, sigmas = ((0.1, 0.0, 0.0), (0.02, 0.02, 0.01)) if k else ((0.0, 0.0, 0.0), None)
        belief = engine.process(Keyframe.planar(k, motion=moved, motion_sigmas=sigmas, detections=seen))
    return belief
