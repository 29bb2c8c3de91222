"""The study of real drives: scores on cases with closed answers, methods, and one short real stretch."""

import itertools
import json
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.commands import run_study
from semantic_slam_lab.peers.joint_compatibility import Innovations, branch_and_bound
from semantic_slam_lab.studies.real_drives import kitti, methods
from semantic_slam_lab.studies.real_drives.batch import batch_cauchy
from semantic_slam_lab.studies.real_drives.ceiling import matched
from semantic_slam_lab.studies.real_drives.drives import chosen_drives, drives_in
from semantic_slam_lab.studies.real_drives.judged import Judged, judged
from semantic_slam_lab.studies.real_drives.scores import association_metrics, map_metrics, object_metrics, path_metrics
from worlds.belief_factory import START, run_configuration, small_belief

from semantic_slam.errors import InputError
from semantic_slam.evaluation.record import GroundTruth, Record
from semantic_slam.evaluation.trajectory import Trajectory, alignment
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import pose_vector_from_planar
from semantic_slam.messages.ground_truth import MOVING, GroundTruthObjects
from semantic_slam.perception.measurement import SemanticMeasurements

SECOND = 1_000_000_000


def measurements(stamp_ns: int, pose: np.ndarray, places: np.ndarray, names: tuple[str, ...]) -> SemanticMeasurements:
    """Exact ranges and bearings of ``places`` (D, 2) from ``pose``; their noise is left to the configuration."""
    offset, count = places - pose[:2], len(places)
    return SemanticMeasurements(
        stamp_ns=stamp_ns,
        sequence=0,
        frame_id="base_link",
        class_names=(),
        detection_ids=np.arange(count, dtype=np.uint32),
        boxes=np.full((count, 4), np.nan),
        labels=("landmark",) * count,
        scores=np.ones(count),
        track_ids=names,
        class_probability_samples=np.zeros((count, 0, 0)),
        features=np.zeros((count, 0)),
        feature_covariances=np.zeros((count, 0, 0)),
        predictive_entropy=np.full(count, np.nan),
        mutual_information=np.full(count, np.nan),
        ranges_m=np.hypot(*offset.T),
        bearings_rad=np.arctan2(offset[:, 1], offset[:, 0]) - pose[2],
        geometric_covariances=np.full((count, 2, 2), np.nan),
        sensor_position=np.zeros(3),
        in_coverage=np.ones(count, dtype=np.bool_),
    )


LANDMARKS = {"a": [2.0, 1.0], "b": [2.0, 1.3], "c": [4.0, -1.0]}


def small_run(
    estimates: list[list[int]],
    seen: list[tuple[str, ...]],
    objects: dict[int, list[float]],
    moving: dict[int, float] | None = None,
) -> Judged:
    """A robot that drives along x, one metre a keyframe, mapped with one hypothesis; ``objects``: id -> position.

    Everything stands 5 m beside the truth, as a map does whose start was not known.
    """
    ids, shift = sorted(objects), np.array([0.0, 5.0, 0.0])
    poses = np.stack([np.arange(len(seen), dtype=float), np.zeros(len(seen)), np.zeros(len(seen))], axis=1)
    stamps = START + SECOND * np.arange(len(seen))
    beliefs = []
    for k, own in enumerate(estimates):
        rows = [ids.index(number) if number >= 0 else -1 for number in own]
        belief = small_belief(k, [k + 1], [k], [1.0], ids, [rows], class_names=())
        places = np.array([[*objects[number], 0.0] for number in ids]) + shift
        beliefs.append(
            replace(
                belief,
                poses=pose_vector_from_planar(poses[k : k + 1] + shift),
                object_poses=pose_vector_from_planar(places),
                moving=np.array([(moving or {}).get(number, np.nan) for number in ids]),
            )
        )
    places = np.array([[*LANDMARKS[name], 0.0] for name in LANDMARKS])
    true = GroundTruthObjects(START, tuple(LANDMARKS), ("landmark",) * 3, pose_vector_from_planar(places))
    trajectory = Trajectory(stamps, pose_vector_from_planar(poses))
    known = {int(stamp): names for stamp, names in zip(stamps, seen, strict=True)}
    frames = {
        int(stamp): measurements(int(stamp), pose, _places(names), ("",) * len(names))
        for stamp, pose, names in zip(stamps, poses, seen, strict=True)
    }
    run = run_configuration(Path("nowhere"), (), ("",) * 7)
    record = Record(run, tuple(beliefs), trajectory, frames, GroundTruth(trajectory, true, known))
    return judged(record, poses + shift)


def _places(names: tuple[str, ...]) -> np.ndarray:
    return np.array([LANDMARKS.get(name, [1.0, 1.0]) for name in names]).reshape(-1, 2)


def test_what_nobody_annotated_costs_pairs_but_not_those_of_annotated_detections() -> None:
    # Object 1 is a; object 2 is a thing without a true id, rightly mapped as one, which claims a pair that is not true.
    run = small_run([[1, 2], [1, 2]], [("a", ""), ("a", "")], {1: LANDMARKS["a"], 2: LANDMARKS["c"]})
    found = association_metrics(run)
    assert found["association_f1"] == pytest.approx(2 / 3)  # one common pair of two claimed and one true
    assert found["association_f1_annotated"] == 1.0


def test_twins_taken_for_each_other_cost_pairs_and_not_clusters() -> None:
    # a and b stand 0.3 m apart: one cluster. Object 1 is a, then b; object 2 the other way round; c is right.
    run = small_run(
        [[1, 2, 3], [2, 1, 3]],
        [("a", "b", "c"), ("a", "b", "c")],
        {1: LANDMARKS["a"], 2: LANDMARKS["b"], 3: LANDMARKS["c"]},
    )
    found = association_metrics(run)
    assert found["association_f1"] == pytest.approx(1 / 3)  # of three pairs claimed and three true ones c's is common
    assert found["association_f1_clusters"] == 1.0
    assert found["duplicates"] == 0
    assert found["ceiling_f1"] == 1.0 and found["f1_of_ceiling"] == pytest.approx(1 / 3)
    # Three pairs stated with certainty, one of them right; the true pairs a-a and b-b are stated with 0: of 15 pairs
    # two are wrongly stated and two wrongly not.
    assert found["pair_right_at_90"] == pytest.approx(1 / 3)
    assert found["pair_ece"] == pytest.approx((2 + 2) / 15)


def test_a_landmark_started_twice_is_a_duplicate_and_no_ghost_and_what_is_far_is_a_ghost() -> None:
    # Object 4 is c again; object 5 has only a false reading and stands 3 m off. The map's frame is 5 m beside the
    # truth's, which alignment takes away.
    run = small_run(
        [[1, 3], [1, 4, 5]],
        [("a", "c"), ("a", "c", "")],
        {1: LANDMARKS["a"], 3: LANDMARKS["c"], 4: LANDMARKS["c"], 5: [4.0, -4.0]},
    )
    assert association_metrics(run)["duplicates"] == 1
    found = object_metrics(run)
    assert (found["num_objects"], found["num_true_objects"], found["ghosts"]) == (4, 2, 1)
    # Two objects too many at c^2 / 2 = 2 m^2 each; the pairs themselves are exact.
    assert found["gospa_m"] == pytest.approx(2.0)


def test_movers_are_counted_where_they_were_seen_ten_times() -> None:
    names = (f"{MOVING}r", f"{MOVING}rare")
    seen = [names] + [names[:1]] * 9
    objects = {1: [1.0, 1.0], 2: [1.0, 1.0]}
    estimates = [[1, 2]] + [[1]] * 9
    assert object_metrics(small_run(estimates, seen, objects, {1: 0.9}))["moving_recall"] == 1.0
    assert object_metrics(small_run(estimates, seen, objects, {1: 0.9}))["num_objects"] == 1  # that stand still
    assert object_metrics(small_run(estimates, seen, objects, {2: 0.9}))["moving_recall"] == 0.0
    assert object_metrics(small_run([[1]] * 10, [("a",)] * 10, {1: [2.0, 1.0]}))["moving_recall"] is None


def test_a_path_that_is_shifted_as_a_whole_has_no_aligned_error() -> None:
    true = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 1.0, 1.0]])
    moved = se2.compose(np.array([3.0, -2.0, 0.7]), true)
    assert path_metrics(moved, true)["ate_aligned_m"] == pytest.approx(0.0, abs=1e-12)
    bent = moved + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
    assert path_metrics(bent, true)["ate_aligned_m"] > 0.01


def test_the_ceiling_takes_every_object_once_and_the_cheapest_together() -> None:
    # From the origin two objects ahead at 2 m and 2.4 m. Ranges 2.3 and 2.5: each is nearest to the farther one, which
    # only one of them can have.
    objects = np.array([[2.0, 0.0], [2.4, 0.0]])
    found = matched(np.zeros(3), objects, np.array([2.3, 2.5]), np.zeros(2))
    assert found.tolist() == [0, 1]
    # A third detection is left over.
    found = matched(np.zeros(3), objects, np.array([2.0, 9.0, 2.4]), np.zeros(3))
    assert found.tolist() == [0, -1, 1]


def test_a_map_metric_knows_unseen_objects_from_ghosts() -> None:
    # The second object stands at a true one that was never seen: too many for GOSPA, and yet no ghost.
    seen, every = np.array([[0.0, 0.0]]), [np.array([0.0, 0.0]), np.array([5.0, 0.0])]
    found = map_metrics(np.array([[0.3, 0.0], [5.0, 0.5]]), seen, every)
    assert found["ghosts"] == 0 and found["gospa_m"] == pytest.approx(np.sqrt(0.09 + 2.0))


def test_objects_that_labels_cannot_judge_are_not_counted() -> None:
    # Object 1 has a label beside one of its detections, 2 beside none, 3 lies in a region that nobody labelled; a
    # detection of object 1 and one of clutter are to be ignored.
    near = np.array([True, False, False, False, False])
    ignored = np.array([False, True, False, True, True])
    assert kitti.counted([1, 2, 3], [1, 1, 2, 3, -1], kitti.Beside(near, ignored)) == (2, 1)


def test_pairs_without_a_label_are_neither_right_nor_wrong() -> None:
    """Of three sights of object 1 two have the same label, and the third none: nobody knows what that one was."""
    own = small_run([[1]] * 3, [("car",), ("car",), ("",)], {1: [2.0, 1.0]})
    assert kitti.pairs_of_labelled(own)["labelled_pair_right_at_90"] == 1.0
    assert association_metrics(own)["pair_right_at_90"] == pytest.approx(1.0 / 3.0)


def test_a_box_lies_in_a_region_by_half_of_its_area() -> None:
    boxes = np.array([[0.0, 0.0, 10.0, 10.0], [6.0, 6.0, 16.0, 16.0]])
    assert kitti.inside(boxes, np.array([[0.0, 0.0, 12.0, 10.0]])).tolist() == [True, False]
    assert kitti.inside(boxes, np.zeros((0, 4))).tolist() == [False, False]


def kitti_folder(folder: Path, metre: float) -> Path:
    """Eight parked cars that a camera passes, a metre of the labels' a picture; poses of a metre that is shorter."""
    frames = range(20)
    poses = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {frame / metre}\n" for frame in frames)
    row = "{} {} Car 0 0 0.0 10 20 30 40 1.6 1.7 4.0 3.0 1.5 {} 0.0\n"
    labels = "".join(row.format(frame, track, 30.0 + 2.0 * track - frame) for frame in frames for track in range(8))
    (folder / "orb_0042.txt").write_text(poses)
    (folder / "label_0042.txt").write_text(labels)
    return folder


def test_kitti_is_judged_in_the_metre_of_its_labels_too(tmp_path: Path) -> None:
    """What moves along in the metre of the poses, and stands in that of the labels, need not be called moving."""
    own = small_run([[1]] * 10, [(f"{MOVING}3",)] * 10, {1: [2.0, 1.0]})
    alike = kitti.metrics_in_labels_metre(own, kitti_folder(tmp_path, 1.0), "0042")
    assert alike["metre_of_labels"] == pytest.approx(1.0)
    assert alike["ate_in_labels_metre_m"] == pytest.approx(0.0, abs=1e-9)
    longer = kitti.metrics_in_labels_metre(own, kitti_folder(tmp_path, 0.9), "0042")
    assert longer["metre_of_labels"] == pytest.approx(0.9)
    assert longer["ate_in_labels_metre_m"] == pytest.approx(0.1 * np.arange(10).std())
    assert longer["moving_recall_in_labels_metre"] is None


@pytest.mark.parametrize("pairs", [[(0, 1)], [(0, 2), (1, 0)], [(0, 2), (1, 0), (2, 1)]])
def test_the_distance_of_pairs_is_twice_the_least_energy_of_their_states(pairs: list[tuple[int, int]]) -> None:
    """Of all states: their squared distance from the prediction, and that of the detections from them in sigmas."""
    generator = np.random.default_rng(6)
    residual, jacobian = generator.normal(scale=3.0, size=(3, 3, 2)), generator.normal(size=(3, 3, 2, 8))
    root = generator.normal(size=(8, 8))
    together = np.concatenate([jacobian[pair] for pair in pairs]) @ root  # of whitened states
    told = np.concatenate([*(residual[pair] for pair in pairs), np.zeros(8)])
    design = np.concatenate([together, np.eye(8)])
    least = told - design @ np.linalg.lstsq(design, told)[0]
    found = Innovations(residual, jacobian, root @ root.T).distance_squared(pairs)
    assert found == pytest.approx(least @ least, rel=1e-9)


def test_joint_compatibility_is_that_of_all_sets_of_pairs() -> None:
    """Against enumeration: most pairs that fit together, the closest of as many. Errors of the robot are shared."""
    generator = np.random.default_rng(5)
    for _ in range(20):
        residual = generator.normal(scale=3.0, size=(3, 3, 2))
        jacobian = np.zeros((3, 3, 2, 8))
        jacobian[..., :2] = generator.normal(size=(3, 3, 2, 2))
        for known in range(3):
            jacobian[:, known, :, 2 + 2 * known : 4 + 2 * known] = generator.normal(size=(3, 2, 2))
        innovations = Innovations(residual, jacobian, np.diag([4.0, 4.0, *[0.5] * 6]))
        assert branch_and_bound(innovations).tolist() == list(_enumerated(innovations))


def _enumerated(innovations: Innovations) -> tuple[int, ...]:
    limits = {n: {1: 9.21034, 2: 13.2767, 3: 16.8119}[n] for n in (1, 2, 3)}  # chi-squared, 99 %, 2 n degrees
    best, found = (0, 0.0), (-1, -1, -1)
    for choice in itertools.product((-1, 0, 1, 2), repeat=3):
        pairs = [(d, o) for d, o in enumerate(choice) if o >= 0]
        if not pairs or max(Counter(o for _, o in pairs).values()) > 1:
            continue
        # Every set on the way down has to fit, too: the tree is cut where one does not.
        if all(innovations.distance_squared(pairs[:n]) <= limits[n] for n in range(1, len(pairs) + 1)) and all(
            innovations.distance_squared([pair]) <= limits[1] for pair in pairs
        ):
            rank = (len(pairs), -innovations.distance_squared(pairs))
            if rank > best:
                best, found = rank, choice
    return found


def test_the_robust_batch_finds_a_drive_with_one_wrong_number() -> None:
    """Exact sights from a square drive, odometry turned a little at every step; one sight carries another's number."""
    base = methods.configuration()
    steps = np.array([[0.5, 0.0, 0.0], [0.5, 0.0, np.pi / 2]] * 8)
    true = se2.along(np.zeros(3), steps)
    driven = se2.along(np.zeros(3), steps + np.array([0.0, 0.0, 0.06]))
    stamps = START + SECOND * np.arange(len(true) + 1)
    places = np.array([[1.0, 2.0], [-1.5, 0.5], [0.5, -1.0]])
    frames, beliefs = {}, []
    for k, pose in enumerate(true):
        names = ("x", "y", "x") if k == 9 else ("x", "y", "z")
        frames[int(stamps[k + 1])] = measurements(int(stamps[k + 1]), pose, places, names)
        belief = small_belief(k, [k + 1], [k], [1.0], [], [[]], class_names=())
        beliefs.append(replace(belief, stamp_ns=int(stamps[k + 1])))
    odometry = Trajectory(stamps, pose_vector_from_planar(np.vstack([np.zeros(3), driven])))
    run = run_configuration(Path("nowhere"), (), ("",) * 7)
    solution = batch_cauchy(Record(run, tuple(beliefs), odometry, frames, None), base, 1.0)
    assert path_metrics(driven, true)["ate_aligned_m"] > 0.1
    assert path_metrics(solution.path, true)["ate_aligned_m"] < 0.02
    landmarks = np.array([solution.landmarks[name] for name in "xyz"])
    motion = alignment(solution.path[:, :2], true[:, :2])
    np.testing.assert_allclose(motion.applied(landmarks), places, atol=0.05)


def test_ours_comes_first_and_what_there_is_not_is_refused() -> None:
    base = methods.configuration()
    assert methods.checked(["given", "ours", "jcbb"], base) == ["ours", "given", "jcbb"]
    assert "without_estimated_noise" in methods.offered(base, everything=True)
    for name, reason in (
        ("without_check", "nothing to switch off"),
        ("jcbb_calibrated", "needs a calibration"),
        ("theirs", "there are ours"),
    ):
        with pytest.raises(InputError, match=reason):
            methods.checked([name], base)


def test_an_ablation_is_offered_where_it_changes_the_configuration() -> None:
    base = methods.configuration()
    independent = replace(base, detection_errors=replace(base.detection_errors, correlated_share=0.0))
    repeating = replace(base, detection_errors=replace(base.detection_errors, correlated_share=0.9))
    assert "without_correlation" in methods.missing(independent)
    assert "without_correlation" not in methods.missing(repeating)
    assert methods.prepared("without_correlation", repeating, methods.Chosen()).configuration == independent


def test_outliers_in_place_are_switched_off_where_there_are_any() -> None:
    base = methods.configuration()
    none, some = (replace(base, detection_errors=replace(base.detection_errors, outlier_share=e)) for e in (0.0, 0.02))
    assert "without_outliers" in methods.missing(none)
    assert "without_outliers" not in methods.missing(some)
    assert methods.prepared("without_outliers", some, methods.Chosen()).configuration == none


def test_others_are_given_the_noise_that_ours_chose() -> None:
    base = methods.configuration()
    told = methods.prepared(
        "nearest_neighbour", base, methods.Chosen(odometry_factor=4.0, detection_factor=4.0)
    ).configuration
    assert told.association == "nearest_neighbour" and told.pruning.max_hypotheses == 1
    assert told.odometry.noise_factors == (1.0,) and told.perception.noise_factors == (4.0,)
    assert told.odometry.sigma_rotation_per_m == pytest.approx(2.0 * base.odometry.sigma_rotation_per_m)
    given = methods.prepared("given", base, methods.Chosen(4.0)).configuration
    assert given == replace(base, association="given", odometry=given.odometry, perception=given.perception)
    assert given.odometry.sigma_rotation_per_m == pytest.approx(2.0 * base.odometry.sigma_rotation_per_m)


def test_drives_are_named_by_what_lies_there(tmp_path: Path) -> None:
    for name in ("mrclam_d9/Robot2_Measurement.dat.gz", "mrclam_d9/Robot1_Measurement.dat", "dlr/dlr.g2o"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert list(drives_in(tmp_path)) == ["mrclam_d9/1", "mrclam_d9/2", "dlr"]
    with pytest.raises(InputError, match="no drive 'dlr/1'; there are mrclam_d9/1"):
        chosen_drives(tmp_path, ["dlr/1"])
    with pytest.raises(InputError, match="holds none of mrclam_"):
        drives_in(tmp_path / "dlr")


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.real_data
def test_a_short_stretch_of_a_real_drive(
    tmp_path: Path, data_set: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    data = data_set("mrclam_d6").parent
    words = ["--drives", "mrclam_d6/4", "--methods", "given", "batch_cauchy", "--quick"]
    out = tmp_path / "out"
    monkeypatch.setattr("sys.argv", ["run_study", "real_drives", "--data", str(data), *words, "--out", str(out)])
    run_study.command()
    result = json.loads((out / "result.json").read_text())
    rows = result["drives"]["mrclam_d6/4"]["methods"]
    assert list(rows) == ["ours", "given", "batch_cauchy"]
    assert not any("fault" in row for row in rows.values())
    assert rows["given"]["association_f1"] == 1.0
    assert rows["given"]["num_objects"] == rows["given"]["num_true_objects"]
    for name in ("given", "batch_cauchy"):
        assert rows[name]["ate_aligned_m"] < 0.5 * rows[name]["dead_reckoning_ate_aligned_m"]
    assert 0.7 < rows["ours"]["ceiling_f1"] < 1.0
    assert (out / "mrclam_d6_4.png").stat().st_size > 10_000
