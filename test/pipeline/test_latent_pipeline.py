"""The shipped latent space from the demo bag's pictures to a report, and the query for look-alikes."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from semantic_slam_msgs.srv import FindLookalike
from worlds.belief_factory import write_belief_bag
from worlds.belief_updates import update_of

from semantic_slam.bag.reader import BagReader
from semantic_slam.class_models.latent_space import load_latent_model
from semantic_slam.cli import bag_to_report, find, find_lookalike
from semantic_slam.configuration import SemanticModelConfiguration, from_dict, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.record import Record
from semantic_slam.inference.building import initial_pose_of, make_run_configuration, problem_of
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior, read_map_prior
from semantic_slam.messages import topics
from semantic_slam.messages.images import decode_image
from semantic_slam.ros.services.in_background import InBackground
from semantic_slam.ros.services.lookalike_service import LookalikeService

pytestmark = pytest.mark.slow  # all share one run with descriptors and its report

ROOT = Path(__file__).parents[2]
BAG, CONFIG = ROOT / "bags" / "aliased_room", ROOT / "config" / "latent.yaml"
KEYFRAMES = 16
SETTINGS = SemanticModelConfiguration(kind="latent")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("latent") / "report"
    with pytest.MonkeyPatch.context() as patch:
        words = ["bag_to_report", str(BAG), "--config", str(CONFIG), "--out", str(out)]
        patch.setattr(sys, "argv", [*words, "--max-keyframes", str(KEYFRAMES)])
        bag_to_report.command()
    return out


@pytest.fixture(scope="module")
def record(report: Path) -> Record:
    return read_record(report / "belief")


@pytest.fixture(scope="module")
def crop(record: Record) -> tuple[np.ndarray, np.ndarray, int]:
    """A picture of the run, the box of an object in it and the object's id."""
    assert record.truth is not None
    stamp, measured = [row for row in record.measurements.items() if row[0] in record.truth.associations][-1]
    pixels = None
    with BagReader(BAG) as reader:
        for message in reader.messages():
            if message.stamp_ns == stamp and message.topic.endswith(topics.IMAGE_COMPRESSED):
                pixels = decode_image(reader.decode(message.cdr, message.type_name), message.topic)
    assert pixels is not None
    widest = int(np.argmax(measured.boxes[:, 2] - measured.boxes[:, 0]))
    return pixels, measured.boxes[widest], int(record.truth.associations[stamp][measured.detection_ids[widest]])


@pytest.mark.long
def test_the_lost_robot_finds_itself_without_classes(report: Path) -> None:
    found = json.loads((report / "report.json").read_text())
    assert found["config"]["semantic_model"]["kind"] == "latent"
    assert found["metrics"]["association_f1"] > 0.95
    assert found["metrics"]["ate_m"] < 0.6
    model = load_latent_model(SETTINGS)
    assert model is not None
    seen = [row for row in found["objects"] if row["n_detections"]]
    assert len(seen) >= 3
    for row in seen:
        assert len(row["descriptor"]) == len(row["descriptor_variance"]) == model.num_dimensions
        assert np.mean(row["descriptor_variance"] < model.prior.sigma[0] ** 2) > 0.9


def test_the_report_shows_the_descriptors(report: Path) -> None:
    page = (report / "report.html").read_text(encoding="utf-8")
    assert "The latent space" in page and "map of the latent space" in page
    document, model = json.loads((report / "objects.json").read_text()), load_latent_model(SETTINGS)
    assert all("descriptor" in row for row in document["objects"])
    assert model is not None and document["descriptor_space"] == model.space


def test_measurements_carry_features_and_elevations(record: Record) -> None:
    model = load_latent_model(SETTINGS)
    assert model is not None
    for measured in record.measurements.values():
        assert measured.features.shape[1] == model.num_features
        assert not measured.feature_covariances.any()
        assert (np.abs(measured.elevations_rad - 0.25) < 0.25).all()


def test_the_command_ranks_the_objects(
    report: Path, crop: tuple, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pixels, box, number = crop
    path = tmp_path / "frame.png"
    cv2.imwrite(str(path), cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))
    words = ["find_lookalike", str(report), str(path), "--box", *(f"{value:g}" for value in box)]
    monkeypatch.setattr(sys, "argv", words)
    find_lookalike.command()
    lines = capsys.readouterr().out.splitlines()[1:]
    shares = [float(line.split()[0]) for line in lines]
    assert sum(shares) == pytest.approx(1.0, abs=2e-3)
    assert shares[:-1] == sorted(shares[:-1], reverse=True)
    assert str(number) in [line.split()[1] for line in lines[:4]]
    limits = ["--region", "90", "90", "99", "99", "--least-probability", "0.1"]
    monkeypatch.setattr(sys, "argv", ["find", *words[1:], *limits])
    find.command()
    (nowhere,) = capsys.readouterr().out.splitlines()[1:]
    assert nowhere.split() == ["1.0000", "-", "none", "of", "them"]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--box", "5", "5", "5", "9"], "box without area"),
        (["--box", "9000", "5", "9900", "9"], "box outside the image"),
    ],
)
def test_bad_boxes_are_named(report: Path, tmp_path: Path, monkeypatch, words: list[str], text: str) -> None:
    path = tmp_path / "crop.png"
    cv2.imwrite(str(path), np.zeros((20, 20, 3), np.uint8))
    monkeypatch.setattr(sys, "argv", ["find_lookalike", str(report), str(path), *words])
    with pytest.raises(InputError, match=text):
        find_lookalike.command()


def test_beliefs_without_descriptors_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    beliefs, _ = write_belief_bag(tmp_path, 2)
    (tmp_path / "no.png").write_bytes(b"not a picture")
    monkeypatch.setattr(sys, "argv", ["find_lookalike", str(beliefs), str(tmp_path / "no.png")])
    with pytest.raises(InputError, match="not a picture"):
        find_lookalike.command()
    cv2.imwrite(str(tmp_path / "yes.png"), np.zeros((20, 20, 3), np.uint8))
    monkeypatch.setattr(sys, "argv", ["find_lookalike", str(beliefs), str(tmp_path / "yes.png")])
    with pytest.raises(InputError, match="kind: latent"):
        find_lookalike.command()


def _run_of(prior: MapPrior) -> RunConfiguration:
    configuration = from_dict({"semantic_model": {"kind": "latent"}})
    return make_run_configuration(configuration, prior, *initial_pose_of(configuration), stamp_ns=1)


def test_a_map_tells_the_descriptors_of_its_objects(report: Path, record: Record) -> None:
    """objects.json of one run is where the next one begins."""
    latent = problem_of(_run_of(read_map_prior(report / "objects.json"))).latent
    assert latent is not None
    last = record.beliefs[-1]
    for row, number in enumerate(last.object_ids):
        told = latent.prior_of(int(number))
        np.testing.assert_allclose(told.mean[0], last.descriptors[row])
        np.testing.assert_allclose(told.sigma[0] ** 2, last.descriptor_covariances[row])


def test_a_map_of_another_latent_space_is_refused(report: Path) -> None:
    prior = read_map_prior(report / "objects.json")
    first = prior.objects[0]
    short = replace(first, descriptor=first.descriptor[:2], descriptor_variance=first.descriptor_variance[:2])
    with pytest.raises(InputError, match="descriptor of 2 components"):
        problem_of(_run_of(replace(prior, objects=(short,))))
    for space in ("latent-0", ""):
        with pytest.raises(
            InputError, match=f"of the latent space '{space}', the model's is '{prior.descriptor_space}'"
        ):
            problem_of(_run_of(replace(prior, descriptor_space=space)))


def test_a_run_is_bound_to_its_latent_space(record: Record) -> None:
    """A backend or a query that has another file than the run had refuses instead of answering wrongly."""
    settings = json.loads(record.run.configuration)["semantic_model"]
    assert settings["space"] == load_latent_model(SETTINGS).space  # type: ignore[union-attr]
    with pytest.raises(InputError, match="wanted is latent-0"):
        load_latent_model(replace(SETTINGS, space="latent-0"))


@pytest.mark.ros
def test_the_service_answers_from_the_newest_belief(record: Record, crop: tuple) -> None:
    pixels, box, number = crop
    rclpy.init()
    node = rclpy.create_node("hypothesis_manager")
    executor = SingleThreadedExecutor()
    try:
        service = LookalikeService(InBackground(node, "services"), load_configuration(CONFIG).semantic_model)
        executor.add_node(node)
        client = node.create_client(FindLookalike, "~/find_lookalike")
        assert client.wait_for_service(timeout_sec=10.0)
        encoded = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))[1].tobytes()
        request = FindLookalike.Request(image=encoded, box=box.tolist())
        early = _answer(client, executor, request)
        assert "no belief yet" in early.fault
        service.update(update_of(record.beliefs[-1]))
        found = _answer(client, executor, request)
        assert found.fault == "" and found.keyframe == KEYFRAMES - 1
        assert sum(found.probabilities) + found.unknown == pytest.approx(1.0)
        assert number in list(found.object_ids)[:4]
        wrong = _answer(client, executor, FindLookalike.Request(image=b"no", box=box.tolist()))
        assert "not a picture" in wrong.fault
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()


def _answer(client, executor, request):
    future = client.call_async(request)
    executor.spin_until_future_complete(future, timeout_sec=30.0)
    assert future.done()
    return future.result()
