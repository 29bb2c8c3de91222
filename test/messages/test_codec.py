"""Every dataclass survives the way over a message and its bytes, value for value."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.same_values import assert_same

from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.object_table import ObjectTable
from semantic_slam.inference.protocol import Candidates, Commit, Components, MissedKeyframes, RunConfiguration
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.messages.codec import BY_TYPE_NAME, CODECS, decode, encode, from_message, to_message
from semantic_slam.messages.ground_truth import GroundTruthAssociations, GroundTruthObjects, ReplayProgress
from semantic_slam.messages.lineage_changes import changes_in, step_of
from semantic_slam.messages.standard import OdometryEstimate, PoseEstimate
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.measurement import SemanticMeasurements

STAMP = 1_700_000_000_123_456_789


def numbers(*shape, dtype=np.float64, start=1):
    """Distinct numbers, so that a transposed or shifted array is seen."""
    return np.arange(np.prod(shape, dtype=int)).astype(dtype).reshape(shape) + dtype(start)


def detections(n=2):
    return Detections(
        stamp_ns=STAMP, frame_id="camera_optical_frame", boxes=numbers(n, 4), labels=("cup", "") * (n // 2),
        scores=numbers(n) / 10, track_ids=("7", "") * (n // 2),
    )  # fmt: skip


def measurements(d=2, t=3, c=4, f=2):
    ranges = numbers(d)
    ranges[:1] = np.nan
    return SemanticMeasurements(
        stamp_ns=STAMP, sequence=5, frame_id="base_link", class_names=tuple("abcd")[:c],
        detection_ids=numbers(d, dtype=np.uint32), boxes=numbers(d, 4), labels=("x",) * d, scores=numbers(d),
        track_ids=("",) * d, class_probability_samples=numbers(d, t, c), features=numbers(d, f),
        feature_covariances=numbers(d, f, f), predictive_entropy=numbers(d), mutual_information=numbers(d),
        ranges_m=ranges, bearings_rad=numbers(d), geometric_covariances=numbers(d, 2, 2),
        sensor_position=numbers(3), in_coverage=numbers(d) > 1, dropped=3,
        free_range_scan=numbers(4, 2), elevations_rad=numbers(d), image_edges_rad=numbers(2, 2),
        free_ranges_m=numbers(16, 24),
    )  # fmt: skip


def belief(h=2, d=3, o=2, c=3, length=0):
    return HybridBelief(
        stamp_ns=STAMP, keyframe=4, planar=True, class_names=("a", "b", "c")[:c], num_candidates=17,
        hypothesis_ids=numbers(h, dtype=np.uint64, start=2**63), parent_ids=numbers(h, dtype=np.uint64),
        modes=numbers(h, dtype=np.uint16), log_weights=-numbers(h), poses=numbers(h, 7),
        pose_covariances=numbers(h, 6, 6), detection_ids=numbers(d, dtype=np.uint32),
        associations=numbers(h, d, dtype=np.int32) - 2, object_ids=numbers(o, dtype=np.uint32),
        object_names=("n",) * o, hypothesis_class_probabilities=numbers(h, o, c), existence=numbers(o),
        class_probabilities=numbers(o, c), object_poses=numbers(o, 7), object_covariances=numbers(o, 6, 6),
        mutual_information=np.full(o, np.nan), in_coverage=numbers(o) > 1, forgotten_views=numbers(o, dtype=np.uint32),
        descriptors=numbers(o, length),
        descriptor_covariances=numbers(o, length), association_entropy=0.5, component_entropy=float("nan"),
        discarded_mass=0.25, dropped=2, num_merged=3, reproducible=False,
    )  # fmt: skip


def candidates(k=2, d=3, p=1):
    return Candidates(
        run_id="run", keyframe=4, backend_id=1, ids=numbers(k, dtype=np.uint64), parent_ids=numbers(k, dtype=np.uint64),
        associations=numbers(k, d, dtype=np.int32), class_assignments=numbers(k, d, dtype=np.int32) - 2,
        modes=numbers(k, dtype=np.uint16), log_weights=numbers(k), effective_sample_sizes=np.full(k, np.nan),
        innovation_nees=numbers(k),
        outlier_probability=numbers(k, d),
        poses=numbers(k, 7), pose_covariances=numbers(k, 6, 6), object_poses=numbers(k, d, 7),
        object_covariances=numbers(k, d, 6, 6), expanded_parent_ids=numbers(p, dtype=np.uint64),
        log_mass_not_enumerated=np.full(p, -np.inf),
    )  # fmt: skip


def components(s=2, o=3, lost=1, length=0):
    objects = ObjectTable(
        object_poses=numbers(s, o, 7), object_covariances=numbers(s, o, 6, 6),
        class_probabilities=numbers(s, o, 4 if s and o else 0), mutual_information=numbers(s, o),
        in_coverage=numbers(s, o) > 1, forgotten_views=numbers(s, o, dtype=np.uint32), existence=numbers(s, o),
        descriptors=numbers(s, o, length), descriptor_covariances=numbers(s, o, length),
    )  # fmt: skip
    return Components(
        run_id="run", keyframe=4, backend_id=1, ids=numbers(s, dtype=np.uint64), poses=numbers(s, 7),
        pose_covariances=numbers(s, 6, 6), object_ids=numbers(o, dtype=np.uint32), objects=objects,
        lost_ids=numbers(lost, dtype=np.uint64), lost_reasons=("an update failed",) * lost,
        noise=numbers(s, 3 if s else 0, 2),
    )  # fmt: skip


def commit(steps, lineages):
    s = len(steps)
    return Commit(
        run_id="run", keyframe=4, ids=numbers(s, dtype=np.uint64), parent_ids=numbers(s, dtype=np.uint64), steps=steps,
        log_weights=-numbers(s), owners=numbers(s, dtype=np.uint32), lineages=lineages,
    )  # fmt: skip


VALUES = {
    "detections": detections(),
    "no detections": detections(0),
    "measurements": measurements(),
    "no measurements": measurements(d=0),
    "belief": belief(),
    "belief with descriptors": belief(length=5),
    "belief without objects": belief(o=0, d=0),
    "belief without classes": belief(c=0),
    "candidates": candidates(),
    "candidates without detections": candidates(d=0),
    "no candidates": candidates(k=0, d=0),
    "components": components(),
    "components with descriptors": components(length=2),
    "no components": components(s=0, o=0, lost=0),
    "commit": commit(
        (LineageStep((1, -1), (0, -1), 2), LineageStep((2, 1), (-1, -1), 0)),
        ((), (LineageStep((), (), 10_403_766), LineageStep((3,), (0,), 0), LineageStep((4, 5, 6), (1, 2, -1), 3))),
    ),
    "commit without detections": commit((LineageStep((), ()),) * 2, ((), ())),
    "no commit": commit((), ()),
    "run": RunConfiguration(
        run_id="id", stamp_ns=STAMP, configuration="{}", map_prior="", initial_pose=numbers(7),
        initial_covariance=numbers(6, 6), class_names=("a", "b"), source='{"path": "x"}', revision="1",
    ),
    "objects": GroundTruthObjects(STAMP, ("1", "2"), ("cup", "box"), numbers(2, 7)),
    "associations": GroundTruthAssociations(STAMP, ("1", "")),
    "progress": ReplayProgress(STAMP, 12, True),
    "missed": MissedKeyframes(run_id="r", backend_id=2, keyframe=7),
    "pose": PoseEstimate(STAMP, "map", numbers(7), numbers(6, 6)),
    "odometry": OdometryEstimate(STAMP, "odom", "base_link", numbers(7), numbers(6, 6)),
}  # fmt: skip


@pytest.mark.parametrize("name", VALUES)
def test_round_trip(name):
    value = VALUES[name]
    assert_same(decode(encode(value), CODECS[type(value)].type_name), value)


def test_round_trip_of_a_keyframe_with_its_run_id():
    keyframe = Keyframe(
        index=3, stamp_ns=STAMP, odometry=numbers(7), odometry_covariance=numbers(6, 6), measurements=measurements()
    )
    message = to_message(keyframe, run_id="run")
    assert message.run_id == "run"
    assert_same(from_message(message), keyframe)


def test_every_codec_is_tried():
    assert {type(value) for value in VALUES.values()} | {Keyframe} == set(CODECS)
    assert len(BY_TYPE_NAME) == len(CODECS)


def test_decoded_arrays_are_aligned_and_writeable():
    scores = decode(encode(detections()), CODECS[Detections].type_name).scores
    assert scores.flags.aligned and scores.flags.writeable


@pytest.mark.parametrize(
    ("value", "field", "size", "expected"),
    [
        (detections(), "boxes", 7, "D=2 x 4"),
        (measurements(), "class_probability_samples", 5, "D=2 x T=3 x C=4"),
        (belief(), "associations", 5, "H=2 x D=3"),
        (belief(), "descriptors", 3, "O=2 x L=1"),
        (candidates(), "object_covariances", 1, "K=2 x D=3 x 6 x 6"),
    ],
)
def test_a_wrong_number_of_rows_names_field_and_shape(value, field, size, expected):
    message = to_message(value)
    wrong = replace(message, **{field: np.zeros(size, getattr(message, field).dtype)})
    with pytest.raises(InputError, match=rf"{field}: {size} values, expected shape \({expected}\)"):
        from_message(wrong)


def test_lineages_that_do_not_add_up():
    message = to_message(VALUES["commit"])
    with pytest.raises(InputError, match="do not add up"):
        from_message(replace(message, lineage_detections=message.lineage_detections + 1))


def test_a_wrong_shape_of_ours_is_a_value_error():
    with pytest.raises(ValueError, match="boxes"):
        encode(replace(detections(), boxes=np.zeros((3, 4))))


@pytest.mark.parametrize("data", [b"", b"\x00\x01\x00\x00\x05"])
def test_bytes_that_are_no_message(data):
    with pytest.raises(InputError, match="do not decode"):
        decode(data, CODECS[HybridBelief].type_name)


def test_an_unknown_type_is_named():
    with pytest.raises(InputError, match="std_msgs/msg/String"):
        decode(b"", "std_msgs/msg/String")


def test_changes_of_a_history_are_whole_and_detections_have_classes():
    """What a backend is told of changes stands behind a keyframe's associations."""
    assert changes_in([-2, 3, 0, 7, 5, -2]) == ((3, 0, 7, 5),)
    with pytest.raises(InputError, match="two objects"):
        changes_in([-2, 3, 0, 7])
    assert step_of([1, -1, -2, 3, 0, 7, 5], [0, 0], 0).changes == ((3, 0, 7, 5),)
    with pytest.raises(InputError, match="1 classes of 2 detections"):
        step_of([1, -1], [0], 0)
