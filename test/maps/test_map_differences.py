"""Two maps are told apart object by object, in one frame or aligned by which objects are the same."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior
from semantic_slam.maps.as_prior import map_prior_of, saved_map_of_prior
from semantic_slam.maps.comparison import Comparison
from semantic_slam.maps.differences import MapDifference, difference
from semantic_slam.maps.map_file import with_id
from semantic_slam.maps.merging import merged
from semantic_slam.maps.saved_map import Provenance, SavedMap, ViewedFrom
from semantic_slam.maps.telling import as_json
from semantic_slam.maps.telling_changes import change_lines, changes_as_json

NAMES = ("chair", "desk", "lamp", "plant")
ROOM = np.array(
    [
        [0.0, 0.0, 0.1],
        [2.0, 0.2, 1.5],
        [4.1, 0.0, -2.0],
        [0.1, 2.2, 3.0],
        [2.2, 2.0, -0.7],
        [4.0, 2.3, 0.4],
        [6.0, 1.0, 2.0],
    ]
)
CLASSES = (0, 0, 1, 1, 2, 2, 3)
EVERYWHERE = ViewedFrom(
    path=np.array([[3.0, 1.0, turn] for turn in np.linspace(-3.0, 3.0, 120)]), region=np.array([0.0, 1.4, 0.3, 6.0])
)


def room(
    poses: np.ndarray = ROOM,
    classes: tuple[int, ...] = CLASSES,
    *,
    frame_m: float = 0.2,
    sigma_rad: float = 0.05,
    first: int = 0,
    looks: ViewedFrom = EVERYWHERE,
) -> SavedMap:
    """Objects known to 3 cm relative to each other, in a frame that is known to ``frame_m``."""
    shares = {n: {name: (0.9997 if k == n else 0.0001) for k, name in enumerate(NAMES)} for n in range(len(NAMES))}
    prior = MapPrior(
        tuple(
            ObjectPrior.planar(
                first + row,
                *pose,
                sigma_m=float(np.hypot(frame_m, 0.03)),
                sigma_rad=sigma_rad,
                class_probabilities=shares[cls],
            )
            for row, (pose, cls) in enumerate(zip(poses.tolist(), classes, strict=True))
        )
    )
    alone = saved_map_of_prior(prior)
    shift = np.kron(np.ones((len(poses), 1)), np.diag([1.0, 1.0, 0.0]))
    own = np.tile([0.03**2, 0.03**2, sigma_rad**2], len(poses))
    joint = frame_m**2 * shift @ shift.T + np.diag(own)
    hypotheses = replace(alone.hypotheses, covariances=joint[None])
    return with_id(replace(alone, hypotheses=hypotheses, has_cross_covariances=True, looks=looks))


def second(T: np.ndarray | None = None, **options: object) -> SavedMap:
    """The room in which object 1 is gone, 4 stands 0.8 m further, and a plant is new; in the frame at ``T``."""
    poses, classes = ROOM.copy(), list(CLASSES)
    poses[4] += [0.7, -0.4, 0.5]
    poses = np.delete(np.vstack([poses, [1.0, 1.1, 0.0]]), 1, axis=0)
    classes = [*classes[:1], *classes[2:], 3]
    if T is not None:
        poses = se2.between(np.broadcast_to(T, poses.shape), poses)
    return room(poses, tuple(classes), first=20, **options)  # type: ignore[arg-type]


def told_of(old: SavedMap, new: SavedMap, same_frame: bool | None = None) -> MapDifference:
    return difference(Comparison.of(old, new, same_frame))


def check(told: MapDifference) -> None:
    kinds = {own.object_id: own.kind for own in told.old}
    assert kinds == {0: "same", 1: "gone", 2: "same", 3: "same", 4: "displaced", 5: "same", 6: "same"}
    assert all(own.probabilities[own.kind] > 0.9 for own in told.old)
    assert told.old[4].new_id == 23 and abs(told.old[4].distance_m - np.hypot(0.7, 0.4)) < 0.05
    (new,) = [own for own in told.new if own.probability > 0.5]
    assert (new.object_id, new.probability > 0.9) == (26, True)
    np.testing.assert_allclose(new.position, [1.0, 1.1], atol=0.05)


def test_what_changed_is_named_in_one_frame() -> None:
    check(told_of(room(), second(), same_frame=True))


@pytest.mark.long
@pytest.mark.parametrize("sigma_rad", [0.05, 3.0])
def test_what_changed_is_named_wherever_the_second_robot_began(sigma_rad: float) -> None:
    """With headings one object of both tells how the maps lie, without them two do."""
    T = np.array([5.0, -2.0, 2.3])
    told = told_of(room(sigma_rad=sigma_rad), second(T, sigma_rad=sigma_rad))
    assert not told.same_frame and told.alignment_probability > 0.99
    check(told)
    np.testing.assert_allclose(told.T_old_new, T, atol=0.05)


def test_what_objects_have_in_common_tells_a_nudge_from_a_frame_that_is_off() -> None:
    """One of seven objects 0.3 m aside, of maps whose frames are known to 0.2 m."""
    poses = ROOM.copy()
    poses[3, 0] += 0.3
    whole, other = room(), room(poses, first=20)
    (nudged,) = [own for own in told_of(whole, other, True).old if own.kind != "same"]
    assert nudged.object_id == 3 and nudged.kind == "displaced"
    off = room(ROOM + np.array([0.3, 0.0, 0.0]), first=20)
    assert all(own.kind == "same" for own in told_of(whole, off, True).old)


def test_what_was_never_looked_at_is_not_said_to_be_gone() -> None:
    aside = ViewedFrom(path=np.tile([20.0, 0.0, 0.0], (40, 1)), region=EVERYWHERE.region)
    old = told_of(room(), second(looks=aside), True).old[1]
    assert old.kind == "unseen" and old.probabilities["gone"] < 0.1


@pytest.mark.long
def test_a_room_like_itself_turned_around_leaves_both_alignments() -> None:
    poses = np.array([[1.0, 1.0, 0.0], [-1.0, -1.0, np.pi], [2.0, -1.0, 1.0], [-2.0, 1.0, 1.0 - np.pi]])
    told = told_of(room(poses, (0, 0, 1, 1)), room(poses, (0, 0, 1, 1), first=20), same_frame=False)
    assert told.alignment_probability == pytest.approx(0.5, abs=0.05)
    assert all(own.probabilities["same"] > 0.9 for own in told.old)
    with pytest.raises(InputError, match="cannot be aligned for sure"):
        merged(room(poses, (0, 0, 1, 1)), room(poses, (0, 0, 1, 1), first=20), "test", same_frame=False)


def test_changes_are_told_in_lines_and_numbers() -> None:
    told = told_of(room(), second(), True)
    text = "\n".join(change_lines(told))
    assert "gone" in text and "displaced" in text and "by 0.8" in text and "new  " in text
    assert {own["kind"] for own in changes_as_json(told)["old"]} == {"same", "gone", "displaced"}


def test_what_was_displaced_to_one_of_several_places_has_no_distance() -> None:
    """Three lamps came 6 m from where one is missing: each is less likely it than that it is gone, all together not."""
    turns = np.array([0.3, 2.4, 4.5])
    places = ROOM[4] + 6.0 * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(3)])
    poses = np.vstack([np.delete(ROOM, 4, axis=0), places])
    told = told_of(room(), room(poses, (0, 0, 1, 1, 2, 3, 2, 2, 2), first=20), True)
    own = told.old[4]
    assert (own.kind, own.new_id) == ("displaced", None) and np.isnan(own.distance_m)
    lines = change_lines(told)
    assert "nan" not in "\n".join(lines) and lines[6].endswith("object_4, to one of several")
    assert changes_as_json(told)["old"][4]["distance_m"] is None


def test_merged_gaussians_are_the_product_of_both() -> None:
    """All objects the same: informations add up, but for the floor between the two maps."""
    one, other = room(), room(ROOM + np.array([0.05, -0.02, 0.01]), first=20)
    both = merged(one, other, "test", same_frame=True)
    floor = np.diag(np.tile([0.03, 0.03, 0.03], len(ROOM))) ** 2
    first, second_ = (own.hypotheses.covariances[0] for own in (one, other))
    expected = np.linalg.inv(np.linalg.inv(first) + np.linalg.inv(second_ + floor))
    np.testing.assert_allclose(both.hypotheses.covariances[0], expected, atol=1e-9)
    off = (other.hypotheses.states[0] - one.hypotheses.states[0]).ravel()
    mean = one.hypotheses.states[0].ravel() + first @ np.linalg.solve(first + second_ + floor, off)
    np.testing.assert_allclose(both.hypotheses.states[0].ravel(), mean, atol=1e-9)
    assert both.objects.ids.tolist() == one.objects.ids.tolist()


@pytest.mark.long
def test_a_merged_map_has_what_was_displaced_where_it_is_now() -> None:
    both = merged(room(), second(np.array([5.0, -2.0, 2.3])), "test")
    assert both.objects.ids.tolist() == [0, 1, 2, 3, 4, 5, 6, 26]
    np.testing.assert_allclose(both.objects.poses[4, :2], ROOM[4, :2] + [0.7, -0.4], atol=0.05)
    assert both.objects.existence[1] < 0.1 < 0.9 < both.objects.existence[7]
    assert both.has_cross_covariances


def test_a_map_without_objects_is_refused_in_one_line_alone(recwarn: pytest.WarningsRecorder) -> None:
    empty = with_id(saved_map_of_prior(MapPrior(())))
    for pair in ((room(), empty), (empty, room())):
        with pytest.raises(InputError, match="compare maps with objects"):
            Comparison.of(*pair)
    assert not recwarn.list


def test_a_map_is_not_merged_with_one_that_holds_it() -> None:
    one = room()
    later = with_id(replace(second(), provenance=Provenance(started_from=one.map_id)))
    with pytest.raises(InputError, match="holds what that one knows"):
        merged(one, later, "test")
    with pytest.raises(InputError, match="name two maps"):
        merged(one, one, "test")


def test_maps_that_came_from_one_map_do_not_count_it_twice() -> None:
    source = Provenance(started_from="0123456789abcdef")
    one, other = (with_id(replace(own, provenance=source)) for own in (room(), room(first=20)))
    both = merged(one, other, "test")
    assert np.linalg.eigvalsh(both.hypotheses.covariances[0] - 0.999 * one.hypotheses.covariances[0]).min() > 0.0


def three_of_one_map() -> list[SavedMap]:
    """Three robots started from one map, and saw nothing: each knows what it was told, existence included."""
    source, maps = Provenance(started_from="0123456789abcdef"), []
    for known in (room(first=first) for first in (0, 20, 40)):
        doubted = replace(known.objects, existence=np.full(len(ROOM), 0.9))
        maps.append(with_id(replace(known, objects=doubted, provenance=source)))
    return maps


def intersected(first: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Covariance intersection with equal weights, and the floor between two maps."""
    floor = np.diag(np.full(len(first), 0.03)) ** 2
    return np.linalg.inv(np.linalg.inv(2.0 * first) + np.linalg.inv(2.0 * other + floor))


@pytest.mark.parametrize("merged_first", [True, False])
def test_three_maps_of_one_map_do_not_count_it_twice_in_whichever_order(merged_first: bool) -> None:
    one, other, third = three_of_one_map()
    both = with_id(merged(one, other, "test"))
    pair = (both, third) if merged_first else (third, both)
    told = merged(*pair, "test", same_frame=True)
    alone, joint = (own.hypotheses.covariances[0] for own in (one, told))
    expected = intersected(*(own.hypotheses.covariances[0] for own in pair))
    np.testing.assert_allclose(joint, expected, atol=1e-9)
    np.testing.assert_allclose(both.hypotheses.covariances[0], intersected(alone, alone), atol=1e-9)
    assert np.linalg.eigvalsh(joint - 0.999 * alone).min() > 0.0, "else surer than what all were told"
    np.testing.assert_allclose(told.objects.existence, 0.9, atol=1e-6)
    np.testing.assert_allclose(told.objects.class_probabilities, one.objects.class_probabilities, atol=2e-5)
    assert told.ancestors == {"0123456789abcdef", *(own.map_id for own in (one, other, third, both))}


def test_maps_of_their_own_are_independent_until_one_is_in_both() -> None:
    one, other, third = (room(first=first) for first in (0, 20, 40))
    left, right = (with_id(merged(own, other, "test", same_frame=True)) for own in (one, third))
    told = merged(left, right, "test", same_frame=True).hypotheses.covariances[0]
    pair = [own.hypotheses.covariances[0] for own in (left, right)]
    np.testing.assert_allclose(told, intersected(*pair), atol=1e-9)
    apart = merged(left, third, "test", same_frame=True).hypotheses.covariances[0]
    floor = np.diag(np.full(len(apart), 0.03)) ** 2
    alone = np.linalg.inv(third.hypotheses.covariances[0] + floor)
    np.testing.assert_allclose(apart, np.linalg.inv(np.linalg.inv(pair[0]) + alone), atol=1e-9)


def test_a_map_is_not_merged_with_one_into_which_it_was_merged() -> None:
    one, other, third = three_of_one_map()
    both = with_id(merged(one, other, "test"))
    later = with_id(replace(third, provenance=Provenance(started_from=both.map_id, ancestors=tuple(both.ancestors))))
    for pair in ((both, one), (other, both), (one, later), (later, both)):
        with pytest.raises(InputError, match="holds what that one knows; use it alone"):
            merged(*pair, "test", same_frame=True)


def of_run(known: SavedMap, keyframe: int, began_ns: int = 70, source: str = "") -> SavedMap:
    """A map as a live run saves it, or the run of a bag; all runs of one configuration have one id."""
    origin = Provenance(run_id="0123456789abcdef", keyframe=keyframe, began_ns=began_ns, source=source)
    return with_id(replace(known, provenance=origin))


@pytest.mark.parametrize("bag", ["", '{"path": "/bags/monday", "sha256": "ab"}'])
def test_two_maps_of_one_run_are_not_merged_and_those_of_two_runs_are(bag: str) -> None:
    early, late = of_run(room(), 100, source=bag), of_run(room(first=20), 200, source=bag)
    for pair in ((early, late), (late, early)):
        with pytest.raises(InputError, match=f"count twice; use the later one, {late.map_id}, alone, or merge it with"):
            merged(*pair, "test")
    copy = with_id(replace(early, discarded_mass=0.01))
    with pytest.raises(InputError, match="use one of them alone"):
        merged(early, copy, "test")
    other = of_run(room(first=20), 200, began_ns=80, source=bag.replace("ab", "cd"))
    assert len(merged(early, other, "test", same_frame=True).objects) == len(ROOM)


def test_a_run_does_not_count_twice_that_is_in_two_maps_by_way_of_others() -> None:
    """One is merged or continued from keyframe 100, the other is of keyframe 200: as for maps of one ancestor."""
    early, late = of_run(room(), 100), of_run(room(first=20), 200)
    both = with_id(merged(early, of_run(room(first=40), 50, began_ns=80), "test", same_frame=True))
    prior = map_prior_of(early)
    told = Provenance(started_from=prior.map_id, ancestors=prior.ancestors, run_id="fedcba9876543210", began_ns=90)
    session = with_id(replace(room(first=60), provenance=told))
    for known in (both, session):
        joint = merged(known, late, "test", same_frame=True).hypotheses.covariances[0]
        expected = intersected(known.hypotheses.covariances[0], late.hypotheses.covariances[0])
        np.testing.assert_allclose(joint, expected, atol=1e-9)


def test_a_comparison_says_that_maps_hold_the_same_observations() -> None:
    early, late = of_run(room(), 100), of_run(second(), 200)
    told, apart = told_of(early, late), told_of(early, of_run(second(), 200, began_ns=80))
    assert told.same_frame and told.shares_evidence and "less sure than stated" in change_lines(told)[1]
    assert changes_as_json(told)["shares_evidence"] is True
    assert not apart.shares_evidence and "less sure" not in "\n".join(change_lines(apart))


def test_a_merged_map_without_ancestors_holds_the_maps_that_it_names() -> None:
    """Files of before state no ancestors; their two maps are in what they say of their source."""
    one, other, _ = three_of_one_map()
    both = merged(one, other, "test")
    before = with_id(replace(both, provenance=replace(both.provenance, ancestors=())))
    assert before.ancestors == {one.map_id, other.map_id}
    assert as_json(before)["provenance"]["ancestors"] == sorted(before.ancestors)
    with pytest.raises(InputError, match="holds what that one knows"):
        merged(before, other, "test")
