"""What a detector confuses is learned from beliefs alone; where there is too little, the models stay as they were."""

from dataclasses import replace

import numpy as np
import pytest
from worlds.bags.bag_factory import of_topic, write_bag, write_configuration
from worlds.bags.places import NUM_FRAMES, place_entries
from worlds.processes.commands import call

from semantic_slam.class_models.detector import load_label_model
from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.shipped import configuration_file
from semantic_slam.training.labels import candidates
from semantic_slam.training.labels.candidates import alike, by_side
from semantic_slam.training.labels.fit import as_they_are, with_known_classes
from semantic_slam.training.labels.judgement import judged
from semantic_slam.training.labels.learn import RunTracks, learn
from semantic_slam.training.labels.maximisation import BeforeFit
from semantic_slam.training.labels.passes import FOLDS, STRETCHES
from semantic_slam.training.labels.report import lines_of, report_of
from semantic_slam.training.labels.tracks import Track
from semantic_slam.training.runs import read_runs
from semantic_slam.viewpoint.detection_values import UNTOLD
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.record import LabelView, LabelWord
from semantic_slam.viewpoint.labels.runner_up import HABITS
from semantic_slam.viewpoint.labels.settings import LabelSettings

LABELS = ("cup", "sofa", "tv")
BEFORE = BeforeFit(num_labels=3, accuracy=0.75, counts=4.0, outlier_share=0.05)
THETA = np.array([[0.9, 0.1, 0.0, 0.0], [0.3, 0.7, 0.0, 0.0], [0.0, 0.0, 0.95, 0.05]])
"""Words of each class: a third of the sofas' views show cups."""
START = LabelModel(
    labels=LABELS,
    settings=LabelSettings.grid((0.0, 0.5), (0.5,), (1.0, 10.0)),
    confusions=(BEFORE.confusion(),),
    class_shares=np.full(4, 0.25),
)


def track(number: int, words: np.ndarray, directions: np.ndarray) -> Track:
    views = [
        LabelView(word=LabelWord(answer=int(word), shares=np.eye(4)[word]), direction=int(cell), log_range=0.0)
        for word, cell in zip(words, directions, strict=True)
    ]
    stretches = np.arange(len(views)) * STRETCHES // len(views)
    return Track(object_id=number, views=tuple(views), stretches=tuple(stretches), weight=1.0, log_prior=None)


def around(random: np.random.Generator, count: int) -> np.ndarray:
    """Cells on a way around an object, from anywhere."""
    return (random.integers(DIRECTIONS) + np.arange(count) * DIRECTIONS // count) % DIRECTIONS


@pytest.fixture
def few_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer ways in which the detector may be set, for less work."""
    for name, values in (("REPEAT_SHARES", (0.0, 0.5)), ("REPEAT_RADS", (0.5,)), ("COUNT_FACTORS", (3.0, 30.0))):
        monkeypatch.setattr(candidates, name, values)


@pytest.mark.long
@pytest.mark.usefixtures("few_settings")
def test_confusions_and_shares_are_found_without_being_told_what_is_what():
    random = np.random.default_rng(0)
    classes = [0, 1, 2, 0, 1, 0] * 3
    tracks = [track(n, random.choice(4, 15, p=THETA[row]), around(random, 15)) for n, row in enumerate(classes)]
    whole = alike(START, BEFORE, tracks).whole.model
    counts = whole.confusions[0].counts[0]
    np.testing.assert_allclose(counts / counts.sum(axis=1, keepdims=True), THETA, atol=0.08)
    np.testing.assert_allclose(whole.class_shares, [10 / 22, 7 / 22, 4 / 22, 1 / 22], atol=0.03)


def test_what_no_fit_has_told_knows_the_classes_that_a_run_would():
    """Else a fit is held against models that take the ninth cup for no likelier than a sofa."""
    random = np.random.default_rng(0)
    tracks = [track(n, random.choice(4, 15, p=THETA[0]), around(random, 15)) for n in range(9)]
    even = as_they_are([START] * len(FOLDS), tracks)
    learned = with_known_classes(even, tracks, counts=1.0)
    objects = even.whole.weights @ even.whole.told.classes
    np.testing.assert_allclose(learned.whole.model.class_shares, (1.0 + objects) / (4.0 + objects.sum()))
    assert learned.held_out > even.held_out + 0.1
    np.testing.assert_allclose(
        with_known_classes(even, tracks, counts=1e9).whole.model.class_shares, START.class_shares, atol=1e-6
    )


def report_as_they_are(model: LabelModel, tracks: list[Track]) -> dict:
    """What is reported of models that are not fitted, as if they were kept, from a run in space."""
    own = as_they_are([model] * len(FOLDS), tracks)
    told = judged(own, tracks)
    return report_of(own, True, told, told) | {"detection": {"runs": 1, "runs_in_space": 1}}


def test_objects_of_a_map_are_reported_and_do_not_tell_how_frequent_their_classes_are():
    random = np.random.default_rng(0)
    classes = [0, 0, 1]
    tracks = [track(n, random.choice(4, 15, p=THETA[row]), around(random, 15)) for n, row in enumerate(classes)]
    mapped = [
        replace(own, log_prior=np.log(np.where(np.arange(4) == row, 1.0, 1e-9)))
        for own, row in zip(tracks, classes, strict=True)
    ]
    report = report_as_they_are(START, mapped)
    assert [own["objects"] for own in report["classes"].values()] == pytest.approx([2.0, 1.0, 0.0], abs=1e-3)
    first, second, *_ = lines_of(report)
    assert first.startswith("cup: 2.0 objects, called cup ") and second.startswith("sofa: 1.0 objects, called sofa ")
    np.testing.assert_array_equal(as_they_are([START] * len(FOLDS), mapped).whole.told.classes, 0.0)
    told = as_they_are([START] * len(FOLDS), tracks).whole.told
    np.testing.assert_array_equal(told.classes, told.objects)


def test_a_detector_with_one_label_has_no_second_name_to_report():
    """Beside one with three, of which the truth is second as often as the habits before any fit have it."""
    before = replace(BEFORE, num_labels=1)
    one = replace(START, labels=("cup",), confusions=(before.confusion(),), class_shares=np.full(2, 0.5))
    views = track(0, np.zeros(6, dtype=int), np.arange(6))
    cup = LabelWord(answer=0, shares=np.eye(2)[0])
    report = report_as_they_are(one, [replace(views, views=tuple(replace(view, word=cup) for view in views.views))])
    assert "truth_second" not in report and not any("second in" in line for line in lines_of(report))
    report = report_as_they_are(START, [views])
    assert report["truth_second"] == pytest.approx(np.mean(1 / 3 + 2 / 3 * HABITS[0]))
    assert any("the truth is second in 53%; 0 rounds" in line for line in lines_of(report))


@pytest.mark.usefixtures("few_settings")
def test_how_often_the_truth_comes_second_is_found():
    random, tracks = np.random.default_rng(4), []
    for number, row in enumerate([0, 1, 0, 1, 0, 1]):
        own = track(number, random.choice(4, 15, p=THETA[row]), around(random, 15))
        answers = [view.word.answer for view in own.views]
        words = [LabelWord(answer=answer, shares=_with_second(answer, row, random)) for answer in answers]
        views = [replace(view, word=word) for view, word in zip(own.views, words, strict=True)]
        tracks.append(replace(own, views=tuple(views)))
    habits = alike(START, BEFORE, tracks).whole.model.habits
    assert habits.sum() == pytest.approx(1.0) and habits[HABITS[0] > 0.0].sum() > 0.8


def _with_second(answer: int, truth: int, random: np.random.Generator) -> np.ndarray:
    """(W,) scores: where the answer is wrong, the truth is second nine times in ten, else anything is."""
    others = [word for word in range(4) if word != answer]
    second = truth if answer != truth and random.random() < 0.9 else int(random.choice(others))
    shares = np.full(4, 0.05)
    shares[answer], shares[second] = 0.6, 0.3
    return shares


@pytest.mark.long
@pytest.mark.usefixtures("few_settings")
def test_a_side_that_looks_like_something_else_is_found_whatever_the_headings():
    """From behind, a third of all directions, sofas are mostly cups; where that is on the map is different for each."""
    random = np.random.default_rng(2)
    tracks = []
    for number in range(8):
        cells, heading = around(random, 24), random.integers(DIRECTIONS)
        is_behind = (cells - heading) % DIRECTIONS < DIRECTIONS // 3
        is_cup = random.random(24) < np.where(is_behind, 0.8, 0.05)
        tracks.append(track(number, np.where(is_cup, 0, 1), cells))
    same = alike(START, BEFORE, tracks)
    found = by_side(same, BEFORE, tracks)
    assert found.held_out > same.held_out + 3.0
    counts = found.whole.model.confusions[0].counts[:, 1]
    cups = np.sort(counts[:, 0] / counts.sum(axis=1))
    assert cups[:6].max() < 0.35 and cups[-3:].min() > 0.45


def labelled_entries(told: str, num_frames: int = NUM_FRAMES, share_of_score: float = 1.0):
    entries = place_entries(told, num_frames)
    for entry in of_topic(entries, topics.DETECTIONS):
        found = from_message(entry.message)
        labels, scores = ("chair", "cup")[: len(found)], share_of_score * found.scores
        entry.message = to_message(replace(found, labels=labels, scores=scores))
    return entries


def labelled_run(folder, name: str, path: str = ""):
    """A run on a short bag whose detector names things in turn; returns the folder of its report."""
    settings = {"kind": "detector", "path": path}
    configuration = write_configuration(folder / "configuration", association="open", semantic_model=settings)
    bag = folder / "bag"
    if not bag.exists():
        write_bag(bag, labelled_entries("ranges"))
    run_bag(bag, folder / name / "belief", load_configuration(configuration))
    return folder / name


def test_too_little_to_learn_from_leaves_the_models_as_they_are(tmp_path, capsys):
    from semantic_slam.viewpoint.labels.store import save_labels

    report = labelled_run(tmp_path, "first")
    fitted = learn(RunTracks.of(read_runs([report])))
    names, detected = lines_of(fitted.report)
    assert names.startswith("too little to learn from, so the models are as before any fit: held-out log evidence")
    assert detected.startswith("detected how often: too little to learn from, so it stays as configured")
    own = load_label_model(
        Configuration.of(semantic_model={"kind": "detector", "labels": fitted.labels}).semantic_model
    )
    assert own is not None
    np.testing.assert_array_equal(fitted.model().priors[0], own.priors[0])
    assert len(fitted.confusions) == len(FOLDS)
    save_labels(fitted, tmp_path / "fitted.safetensors")
    again = labelled_run(tmp_path, "second", str(tmp_path / "fitted.safetensors"))
    assert "was fitted to this bag, too; every stretch of it has the models that were fitted without it" in (
        capsys.readouterr().out
    )
    first, second = (read_runs([folder])[0].record.beliefs[-1] for folder in (report, again))
    np.testing.assert_allclose(second.class_probabilities, first.class_probabilities, atol=1e-9)
    with pytest.raises(InputError, match="are runs of one bag, or of a copy, whose views would count twice"):
        read_runs([report, again])


@pytest.mark.long
def test_a_copy_of_a_bag_is_no_other_bag(tmp_path):
    """That ends one frame earlier; where the detector's scores are others, it is of something else."""
    runs = []
    for name, num_frames, share in (
        ("bag", NUM_FRAMES, 1.0),
        ("copy", NUM_FRAMES - 1, 1.0),
        ("other", NUM_FRAMES, 0.9),
    ):
        bag = write_bag(tmp_path / name, labelled_entries("ranges", num_frames, share))
        runs.append(tmp_path / f"of_{name}")
        run_bag(bag, runs[-1] / "belief", load_configuration(configuration_file("detector")))
    bag, copy, other = runs
    with pytest.raises(InputError, match=r"of_bag and .*of_copy: are runs of one bag, or of a copy"):
        read_runs([bag, other, copy])
    assert len(read_runs([bag, other])) == 2


@pytest.mark.long
def test_how_often_the_detector_detects_is_not_learned_in_space_which_is_said(tmp_path):
    """Beside a run in the plane, which still tells it."""
    bag = write_bag(tmp_path / "bag_in_space", labelled_entries("positions", 12, 0.9))
    (bag / "objects.json").unlink()
    run_bag(bag, tmp_path / "space" / "belief", load_configuration(configuration_file("spatial")))
    in_space = learn(RunTracks.of(read_runs([tmp_path / "space"])))
    *_, detected = lines_of(in_space.report)
    assert detected.startswith("detected how often: not learned from runs with state_space: spatial")
    assert in_space.detection == UNTOLD and all(own.detection == UNTOLD for own in in_space.bags)
    assert in_space.report["detection"]["looks"] == 0
    (tmp_path / "plane").mkdir()
    plane = labelled_run(tmp_path / "plane", "out")
    alone, both = (learn(RunTracks.of(read_runs(own))) for own in ([plane], [tmp_path / "space", plane]))
    assert both.report["detection"]["looks"] == alone.report["detection"]["looks"] > 0
    assert both.report["detection"]["log_evidence"] == alone.report["detection"]["log_evidence"]
    *_, detected = lines_of(both.report)
    assert detected.startswith("detected how often: not learned from 1 of 2 runs with state_space: spatial")


@pytest.mark.parametrize("words", ["--seed 0", "--draws 9", "--elevation-step-deg 10", "--cameras X", "--classes f"])
def test_options_of_pictures_are_refused_beside_runs(words, tmp_path):
    done = call(tmp_path, "semantic_slam.cli.fit_viewpoint_models", "--from-run", "a", "--out", "m", *words.split())
    assert done.returncode == 2
    assert f"{words.split()[0]}: is not for --from-run; leave it out" in done.stderr


def test_runs_that_tell_nothing_of_labels_are_refused(tmp_path):
    with pytest.raises(InputError, match="has no beliefs; give a folder that semantic_slam report --out wrote"):
        read_runs([tmp_path])
    configuration = write_configuration(tmp_path / "configuration", association="open", semantic_model={"kind": "none"})
    run_bag(
        write_bag(tmp_path / "bag", place_entries("ranges")),
        tmp_path / "out" / "belief",
        load_configuration(configuration),
    )
    with pytest.raises(
        InputError, match=r"ran with semantic_model\.kind: none, by which labels and vectors name nothing"
    ):
        read_runs([tmp_path / "out"])
