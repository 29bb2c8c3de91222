"""Bags of older versions: their own definitions tell how our messages were, and what they lack is not given."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from worlds.distinct_values import of
from worlds.same_values import assert_same

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import from_dict
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Components
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.messages.ground_truth import GroundTruthAssociations
from semantic_slam.messages.typestore import DEFINITIONS, PACKAGE
from semantic_slam.perception.frame import Detections
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.report.make import make_report

FIRST_ROUND = Path(__file__).parents[1] / "fixtures" / "first_round"
"""Three keyframes of bags/aliased_room, recorded and reported by the version before beliefs told log_evidence."""
SHIPPED = Path(__file__).parents[2] / "bags"


def definition(name, without=(), renamed=()):
    """Text of one of our definitions, without some fields, others under another name."""
    lines = (DEFINITIONS / f"{name}.msg").read_text().splitlines()
    fields = [line.split("#")[0].split() for line in lines if line.split("#")[0].strip()]
    return "\n".join(f"{kind} {dict(renamed).get(field, field)}" for kind, field in fields if field not in without)


def write_older(path, message, text, nested=(), size=None):
    """A bag with one message of ours by an older definition; ``nested``: texts of nested types of ours, by name.

    ``size``: of the message, where it is cut.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    name = message.__msgtype__
    for kind, own in [*nested, (name, text)]:
        store.register(get_types_from_msg(own, kind))
    embedded = store.generate_msgdef(name, ros_version=2)[0]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/x", name, msgdef=embedded, rihs01="RIHS01_0")
        writer.write(connection, 1, bytes(store.serialize_cdr(message, name))[:size])


def read_one(path):
    with BagReader(path) as reader:
        reader.check_definitions()
        (message,) = reader.messages()
        return reader.decode(message.cdr, message.type_name)


@pytest.mark.slow
def test_a_belief_bag_of_the_first_round_makes_the_report_that_it_made(tmp_path):
    bag = shutil.copy(FIRST_ROUND / "belief.mcap", tmp_path)
    make_report(Path(bag), tmp_path / "report")
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    for part, expected in json.loads((FIRST_ROUND / "report.json").read_text()).items():
        if part == "metrics":  # an alignment may be rounded otherwise
            numbers = {name: value for name, value in expected.items() if isinstance(value, float)}
            assert {name: report[part][name] for name in numbers} == pytest.approx(numbers, rel=1e-12)
            expected |= {name: report[part][name] for name in report[part] if name in numbers or name not in expected}
        if part == "objects":  # what is said of each by now is more
            told = [{name: own[name] for name in before} for own, before in zip(report[part], expected, strict=True)]
            assert told == expected
        else:
            assert report[part] == expected, part


def test_what_the_first_round_did_not_tell_is_not_given():
    belief = read_record(FIRST_ROUND / "belief.mcap").beliefs[-1]
    detections, objects = len(belief.detection_ids), len(belief.object_ids)
    assert detections and objects and belief.state_space == "planar"
    assert np.isnan([belief.log_evidence, belief.innovation_nees, belief.discarded_mass_window]).all()
    assert belief.association_probabilities.shape == (detections, objects + 1)
    assert np.isnan(belief.association_probabilities).all() and np.isnan(belief.object_velocities).all()


def test_the_configuration_of_a_first_round_bag_loads():
    run = read_record(FIRST_ROUND / "belief.mcap").run
    assert from_dict(json.loads(run.configuration)).association == "enumerated"


@pytest.mark.parametrize("path", [SHIPPED / "aliased_room", SHIPPED / "standing.mcap"], ids=lambda path: path.stem)
def test_the_shipped_bags_are_read(path):
    with BagReader(path) as reader:
        reader.check_definitions()
        message = next(reader.messages(["detections"]))
        found = from_message(reader.decode(message.cdr, message.type_name))
    assert len(found) and found.class_names == () and np.isnan(found.positions).all()


def test_a_nested_message_of_an_older_definition(tmp_path):
    keyframe = of(Keyframe)
    nested = definition("SemanticMeasurementArray", without={"place_covariances", "class_scores", "embeddings"})
    kind = f"{PACKAGE}/msg/SemanticMeasurementArray"
    text = definition("Keyframe", without={"odometry_slopes"})
    write_older(tmp_path / "bag", to_message(keyframe, run_id="run"), text, [(kind, nested)])
    found = from_message(read_one(tmp_path / "bag"))
    assert found.odometry_slopes is None
    assert found.measurements.embeddings.shape == (len(keyframe.measurements), 0)
    assert np.isnan(found.measurements.class_scores).all()
    np.testing.assert_array_equal(found.odometry_covariance, keyframe.odometry_covariance)
    np.testing.assert_array_equal(found.measurements.boxes, keyframe.measurements.boxes)


@pytest.mark.parametrize("kind", [Detections, SemanticMeasurements, HybridBelief, Candidates])
def test_what_an_older_definition_has_is_kept(kind, tmp_path):
    """As if the definition had ended two fields earlier."""
    value = of(kind)
    message = to_message(value)
    name = message.__msgtype__.rsplit("/", 1)[1]
    lines = definition(name).splitlines()
    write_older(tmp_path / "bag", message, "\n".join(lines[:-2]))
    found = read_one(tmp_path / "bag")
    for line in lines[:-2]:
        field = line.split()[1]
        np.testing.assert_array_equal(np.asarray(getattr(found, field)), np.asarray(getattr(message, field)), field)


def test_a_field_under_its_former_name(tmp_path):
    value = of(Components)
    message = to_message(value)
    text = definition("Components", renamed={"descriptor_covariances": "descriptor_variances"}.items())
    write_older(tmp_path / "bag", renamed_message(message, text), text)
    assert_same(from_message(read_one(tmp_path / "bag")), value)


def renamed_message(message, text):
    """The message as an object with the former name."""
    fields = {name: getattr(message, name, None) for name in (line.split()[1] for line in text.splitlines())}
    fields["descriptor_variances"] = message.descriptor_covariances
    return type("Older", (), fields | {"__msgtype__": message.__msgtype__})()


def test_a_bag_of_a_newer_version_is_refused_with_the_field(tmp_path):
    message = to_message(of(GroundTruthAssociations))
    message.__dict__["certainty"] = np.ones(1)
    write_older(tmp_path / "bag", message, definition("GroundTruthAssociations") + "\nfloat64[] certainty")
    with pytest.raises(InputError, match=r"GroundTruthAssociations.*field certainty.*record"):
        read_one(tmp_path / "bag")


def test_damaged_bytes_of_an_older_definition_are_the_bags_fault(tmp_path):
    text = definition("DetectionArray", without={"place_covariances"})
    write_older(tmp_path / "bag", to_message(of(Detections)), text, size=40)
    with pytest.raises(InputError, match="does not decode"):
        read_one(tmp_path / "bag")
