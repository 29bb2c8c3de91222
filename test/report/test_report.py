"""Reports of made-up runs: the files' names and fields, hostile names, damaged bags, no network."""

import dataclasses
import json
import math
import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import (
    CLASSES,
    OBJECT_CLASSES,
    OBJECTS,
    odometry_message,
    run_configuration,
    small_belief,
    write_belief_bag,
    write_rows,
)

from semantic_slam.bag.writer import BagWriter
from semantic_slam.configuration import Configuration, SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import _Collected, read_record
from semantic_slam.geometry.pose import PLANAR_AXES
from semantic_slam.geometry.se2 import rotate_covariance
from semantic_slam.inference.building import make_run_configuration, problem_of
from semantic_slam.inference.building.class_prior import LEAST_CLASS_SHARE
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.world.map_prior import parse_map_prior, read_map_prior
from semantic_slam.maps.saved_map import Provenance
from semantic_slam.messages import topics
from semantic_slam.pipeline.diagnostics import dropped_message
from semantic_slam.report.document import map_prior
from semantic_slam.report.drawing.ellipse import ellipses
from semantic_slam.report.drawing.plot import Plot, nice_ticks
from semantic_slam.report.make import make_report
from semantic_slam.report.plain_json import plain, to_text
from semantic_slam.report.shown.scene import moments
from semantic_slam.report.wording import number, percent

KEYFRAMES = 24
REPORT_FIELDS = {"schema_version", "bag", "config", "seed", "revision", "keyframes", "objects", "dropped"}
KEYFRAME_FIELDS = {
    *("k", "stamp_ns", "n_detections", "n_candidates", "n_hypotheses", "association_entropy", "component_entropy"),
    *("discarded_mass", "best"),
}
METRICS = {
    *("association_f1_annotated", "detections_without_true_id", "objects_without_true_id"),
    *("association_f1", "association_precision", "association_recall", "keyframe_disambiguated"),
    *("min_true_class_probability", "ate_m", "ate_aligned_m", "dead_reckoning_ate_m"),
    *("dead_reckoning_true_start_ate_m", "nees_mean", "class_nll", "class_ece"),
}
HOSTILE = "<script>alert('x')</script><img src=http://evil.example/a.png>"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a report of a run with ground truth and pictures."""
    folder = tmp_path_factory.mktemp("made")
    beliefs, _ = write_belief_bag(folder, KEYFRAMES)
    files = make_report(beliefs, folder / "report")
    assert {path.name for path in files} == {"report.json", "objects.json", "trajectory.tum", "report.html"}
    return folder / "report"


def load(folder: Path) -> dict:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    return json.loads((folder / "report.json").read_text(), parse_constant=refuse)


def test_report_json_has_every_field(made: Path) -> None:
    report = load(made)
    assert set(report) >= REPORT_FIELDS
    assert set(report["bag"]) >= {"path", "sha256", "n_keyframes"}
    assert report["bag"]["n_keyframes"] == len(report["keyframes"]) == KEYFRAMES
    assert [row["k"] for row in report["keyframes"]] == list(range(KEYFRAMES))
    for row in report["keyframes"]:
        assert set(row) >= KEYFRAME_FIELDS
        assert set(row["best"]) >= {"id", "weight", "pose", "associations"}
        assert len(row["best"]["associations"]) == row["n_detections"]
    for row in report["objects"]:
        assert set(row) >= {"id", "class_probabilities", "existence", "pose", "covariance"}
        assert sum(row["class_probabilities"].values()) == pytest.approx(1.0)
    assert set(report["metrics"]) >= METRICS
    assert (report["seed"], report["revision"]) == (5, "0123abc")


def test_metrics_of_the_script(made: Path) -> None:
    """The factory's first lineage is the truth seen from the right place; the others are dead from keyframe 13 on."""
    metrics = load(made)["metrics"]
    assert metrics["association_f1"] == metrics["association_precision"] == metrics["association_recall"] == 1.0
    assert metrics["association_f1_annotated"] == 1.0 and metrics["objects_without_true_id"] == 0
    assert metrics["keyframe_disambiguated"] == 13
    assert metrics["ate_aligned_m"] <= metrics["ate_m"] < 0.2 < metrics["dead_reckoning_true_start_ate_m"]
    # The prior's mean is off by (6, -5): dead reckoning from it is wrong by about that much.
    assert metrics["dead_reckoning_ate_m"] == pytest.approx(math.hypot(6, 5), rel=0.25)
    assert metrics["min_true_class_probability"] < 0.6  # the desk that could be a crate


def test_a_lost_hypothesis_does_not_hide_inputs_that_were_dropped() -> None:
    belief = dataclasses.replace(small_belief(0, [1], [0], [1.0], [0], [[0]]), dropped=4)
    lost = _Collected(dropped={("semantic_slam: hypotheses", "hypothesis lost: x"): 1})
    assert lost.reasons((belief,)) == {"hypothesis lost: x": 1, "reason not recorded": 4}
    named = _Collected(dropped={("semantic_slam: frames", "late"): 4})
    assert named.reasons((belief,)) == {"late": 4}


def test_what_a_node_dropped_before_it_was_started_again_counts_too(tmp_path: Path) -> None:
    """By node and reason: the classifier counts 2, 5, then anew 1, 3, and anew 2; the manager counts 4 throughout."""
    with BagWriter(tmp_path / "bag") as writer:
        writer.write(topics.RUN_CONFIGURATION, run_configuration(Path("drive"), CLASSES, tuple("1234567")), 1)
        writer.write(topics.BELIEF, small_belief(0, [1], [0], [1.0], [0], [[0]]), 1)
        for stamp, count in enumerate((2, 5, 0, 1, 3, 2), start=1):
            dropped = {"classifier": Counter(late=count) + Counter(), "manager": Counter(late=4, early=1)}
            writer.write(topics.DIAGNOSTICS, dropped_message(stamp, dropped), stamp)
    assert read_record(tmp_path / "bag").dropped == {"late": 5 + 3 + 2 + 4, "early": 1}


def test_objects_come_back_as_a_map_prior(made: Path) -> None:
    prior, rows = read_map_prior(made / "objects.json"), load(made)["objects"]
    assert [item.object_id for item in prior.objects] == [row["id"] for row in rows]
    for item, row in zip(prior.objects, rows, strict=True):
        assert item.pose == pytest.approx(row["pose"], abs=0)
        assert item.covariance == pytest.approx(np.array(row["covariance"]), abs=0)
        assert item.class_probabilities == row["class_probabilities"]


def test_objects_name_the_maps_and_the_recording_whose_information_they_hold(made: Path) -> None:
    """Else ``map merge`` would count what the run was told at its start, and what it has seen, twice."""
    record = read_record(made.parent / "belief")
    told = dataclasses.replace(read_map_prior(made / "objects.json"), map_id="monday", ancestors=("sunday",))
    later = dataclasses.replace(record, run=dataclasses.replace(record.run, map_prior=told.to_json()))
    recording = Provenance(source=record.run.source).recording
    assert recording.startswith("recording:") and recording in map_prior(record).ancestors
    told_on = parse_map_prior(map_prior(later).to_json(), "as it travels")
    assert told_on.ancestors == ("monday", recording, "sunday")


def test_a_later_run_starts_from_the_objects(made: Path) -> None:
    """What the engine takes as its prior is what the report wrote, in place, spread and class."""
    settings = Configuration(semantic_model=SemanticModelConfiguration(kind="none"))
    prior = read_map_prior(made / "objects.json")
    run = make_run_configuration(settings, prior, np.array([0.0, 0, 0, 0, 0, 0, 1]), np.eye(6), stamp_ns=0)
    problem = problem_of(dataclasses.replace(run, class_names=CLASSES))
    for entry, row in zip(problem.objects, load(made)["objects"], strict=True):
        assert entry.object_id == row["id"]
        assert entry.prior.mean[:2] == pytest.approx(row["pose"][:2])
        in_map = rotate_covariance(entry.prior.mean, entry.prior.covariance)
        assert in_map == pytest.approx(np.array(row["covariance"])[np.ix_(PLANAR_AXES, PLANAR_AXES)], abs=1e-8)
        written = np.array([row["class_probabilities"][name] for name in CLASSES])
        floored = (1.0 - LEAST_CLASS_SHARE) * written + LEAST_CLASS_SHARE / len(CLASSES)
        assert entry.class_prior == pytest.approx(floored)


def test_trajectory_is_tum(made: Path) -> None:
    rows = np.loadtxt(made / "trajectory.tum")
    assert rows.shape == (KEYFRAMES, 8)
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert np.linalg.norm(rows[:, 4:], axis=1) == pytest.approx(np.ones(KEYFRAMES))


class Loads(HTMLParser):
    """Collects whatever a browser would fetch, and the page's scripts."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [
            value or "" for name, value in attributes if name in ("src", "href", "data", "srcset", "action")
        ]


def test_the_page_fetches_nothing(made: Path) -> None:
    text = (made / "report.html").read_text()
    page = Loads()
    page.feed(text)
    assert page.tags.count("img") == 12 + text.count('class="crop"')
    assert all(address.startswith("data:image/jpeg;base64,") for address in page.addresses)
    assert "link" not in page.tags and "iframe" not in page.tags
    styles = "".join(re.findall(r"<style>.*?</style>", text, re.S))
    assert "url(" not in styles and "@import" not in styles
    assert "default-src 'none'" in text


def test_hostile_names_are_text(tmp_path: Path) -> None:
    names = ("crate", HOSTILE, "desk")
    beliefs, _ = write_belief_bag(tmp_path, 6, class_names=names, object_names=(HOSTILE, *"234567"))
    make_report(beliefs, tmp_path / "report")
    text = (tmp_path / "report" / "report.html").read_text()
    page = Loads()
    page.feed(text)
    assert page.tags.count("script") == 2  # the data of the map and our own script
    assert all(address.startswith("data:image/jpeg") for address in page.addresses)
    assert "<script>alert" not in text and "&lt;script&gt;alert" in text
    data = re.search(r'<script type="application/json" id="scene">(.*?)</script>', text, re.S)
    assert data is not None
    assert json.loads(data[1])["classes"][1]["name"] == HOSTILE


def test_without_ground_truth_there_are_no_metrics(tmp_path: Path) -> None:
    beliefs, _ = write_belief_bag(tmp_path, 6, with_truth=False)
    make_report(beliefs, tmp_path / "report")
    assert "metrics" not in load(tmp_path / "report")
    assert "Against the ground truth" not in (tmp_path / "report" / "report.html").read_text()


def test_one_keyframe_without_objects_classes_or_detections(tmp_path: Path) -> None:
    belief = small_belief(0, [1], [0], [1.0], [], [[]], class_names=())
    write_rows(tmp_path / "bag", [(topics.RUN_CONFIGURATION, 1, empty_run(tmp_path)), (topics.BELIEF, 1, belief)])
    make_report(tmp_path / "bag", tmp_path / "report")
    report = load(tmp_path / "report")
    assert report["objects"] == [] and report["keyframes"][0]["best"]["associations"] == []
    assert read_map_prior(tmp_path / "report" / "objects.json").objects == ()


def test_an_object_that_no_hypothesis_has_placed(tmp_path: Path) -> None:
    belief = small_belief(0, [1], [0], [1.0], [3, 4], [[0]])
    poses, covariances = belief.object_poses.copy(), belief.object_covariances.copy()
    poses[1], covariances[1] = np.nan, np.nan
    belief = dataclasses.replace(belief, object_poses=poses, object_covariances=covariances)
    write_rows(tmp_path / "bag", [(topics.RUN_CONFIGURATION, 1, empty_run(tmp_path)), (topics.BELIEF, 1, belief)])
    make_report(tmp_path / "bag", tmp_path / "report")
    assert load(tmp_path / "report")["objects"][1]["pose"] == [None] * 7
    assert [item.object_id for item in read_map_prior(tmp_path / "report" / "objects.json").objects] == [3]


def test_odometry_and_provenance_that_are_no_such_thing(tmp_path: Path) -> None:
    belief = small_belief(0, [1], [0], [1.0], [3], [[0]])
    run = dataclasses.replace(empty_run(tmp_path), source="[1", configuration="")
    broken = odometry_message(5, np.full(3, np.nan), "odom")
    rows = [(topics.RUN_CONFIGURATION, 1, run), (topics.ODOMETRY, 5, broken), (topics.BELIEF, 1, belief)]
    write_rows(tmp_path / "bag", [*rows, (topics.GROUND_TRUTH_ODOMETRY, 5, broken)])
    make_report(tmp_path / "bag", tmp_path / "report")
    report = load(tmp_path / "report")
    assert report["bag"]["path"] == str(tmp_path / "bag") and len(report["bag"]["sha256"]) == 64
    assert report["metrics"]["ate_m"] is None and report["metrics"]["nees_mean"] is None


def empty_run(folder: Path) -> RunConfiguration:
    run = run_configuration(folder / "source", (), ("",) * len(OBJECTS))
    return dataclasses.replace(run, map_prior="", source="")


def test_a_damaged_bag_is_reported_up_to_the_damage(tmp_path: Path) -> None:
    beliefs, _ = write_belief_bag(tmp_path, 8)
    whole = next(beliefs.glob("*.mcap")).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 9 // 10])
    make_report(cut, tmp_path / "report")
    report = load(tmp_path / "report")
    assert str(cut) in report["fault"] and 0 < report["bag"]["n_keyframes"] <= 8
    assert "the bag is damaged" in (tmp_path / "report" / "report.html").read_text()


def test_bags_without_beliefs_or_configuration(tmp_path: Path) -> None:
    beliefs, source = write_belief_bag(tmp_path, 2)
    with pytest.raises(InputError, match=f"{source}.*belief"):
        make_report(source, tmp_path / "report")
    write_rows(tmp_path / "bare", [(topics.BELIEF, 1, read_record(beliefs).beliefs[0])])
    with pytest.raises(InputError, match="run_configuration"):
        make_report(tmp_path / "bare", tmp_path / "report")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="another output"):
        make_report(beliefs, tmp_path / "file")


def test_pictures_that_are_gone(tmp_path: Path) -> None:
    beliefs, source = write_belief_bag(tmp_path, 4)
    source.rename(tmp_path / "elsewhere")
    make_report(beliefs, tmp_path / "without")
    make_report(beliefs, tmp_path / "with", source_bag=tmp_path / "elsewhere")
    assert "<img" not in (tmp_path / "without" / "report.html").read_text()
    assert "<img" in (tmp_path / "with" / "report.html").read_text()


def test_json_holds_no_nan() -> None:
    value = {"a": np.array([1.0, np.nan]), "b": (np.float64("inf"), np.uint64(2**64 - 1)), 3: [float("nan")]}
    assert plain(value) == {"a": [1.0, None], "b": [None, 2**64 - 1], "3": [None]}
    assert json.loads(to_text(value)) == plain(value)


def test_the_page_says_what_it_found(made: Path) -> None:
    text = (made / "report.html").read_text()
    assert f"{len(OBJECT_CLASSES)} objects are on the map" in text
    assert "Object 7 is ambiguous: desk" in text
    assert "from keyframe 13 on" in text


def test_moments_are_first_last_and_apart() -> None:
    beliefs = tuple(
        dataclasses.replace(small_belief(k, [1], [0], [1.0], [3], [[0]]), association_entropy=float(k < 20))
        for k in range(60)
    )
    assert moments(beliefs) == [0, 20, 39, 59]
    assert moments(beliefs[:1]) == [0]


def test_ellipses_are_the_eigenvectors() -> None:
    """Semi-axes 3 along 30 degrees and 1 across it."""
    axis = np.array([math.cos(math.pi / 6), math.sin(math.pi / 6)])
    covariances = np.zeros((2, 6, 6))
    covariances[0, :2, :2] = np.eye(2) + 8.0 * np.outer(axis, axis)
    covariances[1] = np.nan
    assert ellipses(covariances)[0] == pytest.approx([3.0, 1.0, math.pi / 6])
    assert np.isnan(ellipses(covariances)[1]).all()


def test_ticks_are_round_and_inside() -> None:
    assert nice_ticks(0.0, 1.0) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert nice_ticks(-0.5, 59.5, 6) == pytest.approx([0, 10, 20, 30, 40, 50])
    assert nice_ticks(3e-4, 8e-4) == pytest.approx([3e-4, 4e-4, 5e-4, 6e-4, 7e-4, 8e-4])


def test_a_line_breaks_where_nothing_is_known() -> None:
    plot = Plot((0, 4), (0, 1))
    plot.line([0, 1, 2, 3, 4], [0.1, 0.2, float("nan"), 0.4, 0.5], "line")
    assert str(plot.svg()).count("<polyline") == 2


def test_a_value_beyond_the_scale_is_marked_at_its_edge() -> None:
    plot = Plot((0, 4), (0.01, 1.0), logarithmic=True)
    plot.line([0, 1, 2, 3, 4], [0.01, 0.001, 0.0, 2.0, float("nan")], "line")
    drawn = str(plot.svg())
    assert drawn.count("below the scale") == 2 and drawn.count("above the scale") == 1


def test_a_probability_that_rounding_takes_beyond_one_is_not_beyond_the_scale() -> None:
    plot = Plot((0, 2), (0.0, 1.0))
    plot.line([0, 1, 2], [np.nextafter(1.0, 2.0), 0.5, -1e-17], "line")
    assert "the scale" not in str(plot.svg())


def test_wording_never_rounds_doubt_away() -> None:
    assert [percent(value) for value in (1.0, 0.9999, 0.998, 0.995, 0.5, 0.0)] == [
        "100 %",
        "> 99.9 %",
        "99.8 %",
        "99.5 %",
        "50 %",
        "0 %",
    ]
    assert percent(1e-5) == "< 0.1 %"
    assert (number(-0.001), number(None), number(float("nan")), number(-1.5, 1)) == ("0.00", "–", "–", "−1.5")
