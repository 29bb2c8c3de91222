"""What a checkpoint is made of comes back to the bit, and nothing else is read."""

from typing import Any

import gtsam
import numpy as np
import pytest
from worlds.scenes.rounds import START_SIGMAS, Rounds

from semantic_slam import Configuration, Engine
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.checkpoints.records import packed, unpacked
from semantic_slam.inference.checkpoints.stored_component import _made_again, restored, stored
from semantic_slam.inference.models.callback_factor import source_of
from semantic_slam.inference.models.odometry_bias import biased_factor
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.planar.observation import PlanarObservation
from semantic_slam.inference.models.planar.visibility import PlanarVisibility
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.past.summary import Summary
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import bias_key, object_key, robot_key
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces

RANDOM = np.random.default_rng(3)
SPACES, MODEL = Spaces.same(PlanarPoses()), PlanarObservation(None, PlanarVisibility())
ROOT = Component.root(SPACES, MODEL, GaussianPrior(mean=np.zeros(3), covariance=np.eye(3)), {})
KEYS = (robot_key(4), object_key(2))


def positive(size: int) -> Array:
    root = RANDOM.normal(size=(size, size))
    return root @ root.T + np.eye(size)


def with_bearing_alone() -> Any:
    detection = PlanarDetection(
        range_m=np.nan,
        bearing_rad=0.3,
        covariance=positive(2),
        sensor=RANDOM.normal(size=2),
        feature=np.zeros(0),
        feature_covariance=np.zeros((0, 0)),
    )
    return MODEL.geometry_factor(detection, KEYS)


def with_biases() -> Any:
    keys = (robot_key(3), robot_key(4), bias_key(4))
    return biased_factor(keys, RANDOM.normal(size=3), positive(3), RANDOM.normal(size=(3, 4)))


def of_the_past() -> Any:
    root = np.asfortranarray(RANDOM.normal(size=(6, 6)))
    keys = tuple(sorted(KEYS))
    return Summary(keys=keys, root=root, right=RANDOM.normal(size=6), coordinates=RANDOM.normal(size=6)).factor(SPACES)


def flown(association: str) -> tuple[Component, Component]:
    """A component of a camera that sees points by rays alone, right after a marginalisation, and its root."""
    settings = {
        "observation": "points",
        "semantic_model": {"kind": "none"},
        "open_world": {"field_of_view_rad": 1.4, "vertical_field_of_view_rad": 1.4},
        "detection_errors": {"ray_tail_sigmas": 1.0},
        "history": {"horizon_keyframes": 20},
    }
    configuration = Configuration.of(state_space="spatial", association=association, **settings)
    flight, spread = Rounds(2, 4, has_depth=False, are_named=association == "given"), np.diag(START_SIGMAS**2)
    engine = Engine(configuration, initial_pose=Rounds.pose(0), initial_covariance=spread)
    for keyframe in flight.keyframes(25):
        engine.process(keyframe)
    (backend,) = engine.pool._backends  # type: ignore[attr-defined]
    return engine.pool.component(next(iter(engine.live))), backend.association.root(0)  # type: ignore[attr-defined]


@pytest.mark.long
@pytest.mark.parametrize("association", ["given", "open"])
def test_a_component_in_space_comes_back_to_the_bit(association: str) -> None:
    """With rays from a camera beside the body, ranges known by their logarithms, gravity, and a summary of the past."""
    component, root = flown(association)
    data = stored(component)
    again = restored(data, root)
    ours, theirs = component.smoother.isam, again.smoother.isam
    assert np.array_equal(ours.getDelta().vector(), theirs.getDelta().vector())
    assert ours.getLinearizationPoint().serialize() == theirs.getLinearizationPoint().serialize()
    kinds = [type(source).__name__ for source in unpacked(data)[1].sources.values()]
    assert set(kinds) == {"Sighting", "StartedByRay", "Summary"}
    at = ours.getLinearizationPoint()
    for one, other in zip(*(own.getFactorsUnsafe().linearize(at).jacobian() for own in (ours, theirs)), strict=True):
        assert np.array_equal(one, other)
    assert stored(again) == data


@pytest.mark.parametrize("make", [with_bearing_alone, with_biases, of_the_past])
def test_a_factor_with_a_callback_is_made_again_to_the_bit(make: Any) -> None:
    factor = make()
    again = _made_again(unpacked(packed(source_of(factor))), ROOT)
    values = gtsam.Values()
    for key in factor.keys():  # noqa: SIM118
        if key == bias_key(4):
            values.insert(key, RANDOM.normal(size=4))
        else:
            values.insert(key, gtsam.Pose2(*RANDOM.normal(size=3)))
    for ours, theirs in zip(factor.linearize(values).jacobian(), again.linearize(values).jacobian(), strict=True):
        assert np.array_equal(ours, theirs)


def test_another_callback_tells_no_source() -> None:
    def error(_: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        return values.atPoint2(1)

    with pytest.raises(TypeError):
        source_of(gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(2), [1], error))


def test_numbers_and_arrays_come_back_with_their_types_and_order_in_memory() -> None:
    columns = np.asfortranarray(RANDOM.normal(size=(3, 4)))
    value = (0.1 + 0.2, -0.0, np.inf, 2**62 + 1, True, None, np.float64(1.0) / 3.0, [columns], {3: frozenset({1, 2})})
    found = unpacked(packed(value))
    assert repr(found) == repr(value)
    assert np.array_equal(found[7][0], columns) and found[7][0].flags.f_contiguous
    assert np.isnan(unpacked(packed(np.nan)))


@pytest.mark.parametrize(
    "kind",
    [
        "subprocess.Popen",
        "semantic_slam.outputs.Path",
        "semantic_slam.inference.backend.Backend",
        "semantic_slam.ros.launching.node_set.NodeSpec",
    ],
)
def test_no_record_makes_anything_but_dataclasses_that_are_data(kind: str) -> None:
    """Among otherwise good bytes, in the place of a None."""
    module, _, name = kind.rpartition(".")
    good = packed(None)
    size = 8 + int.from_bytes(good[:8], "little")
    assert good[8:size].endswith(b"null]")
    text = good[8 : size - 5] + f'["object", "{module}", "{name}", {{}}]]'.encode()
    with pytest.raises(ValueError, match=r"no record of this version \(TypeError\)"):
        unpacked(len(text).to_bytes(8, "little") + text + good[size:])


@pytest.mark.parametrize("text", [b"null", b"[1]", b"[1, 2, 3]", b"[{}, 1]", b"{", b"[[], []]"])
def test_bytes_that_are_no_record_are_refused(text: bytes) -> None:
    with pytest.raises(ValueError, match="no record of this version"):
        unpacked(len(text).to_bytes(8, "little") + text)


def test_what_has_no_record_is_refused() -> None:
    for value in (object(), np.array([object()]), [gtsam.Pose2()]):
        with pytest.raises(TypeError, match="no record"):
            packed(value)
