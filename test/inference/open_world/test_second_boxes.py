"""Second boxes of one thing start no object; two things that stand together are two all the same."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.inference.belief import HybridBelief

THING = 2.0, 0.0
SHARE, WIDTH_M = 0.05, 0.3


def existence_of_second(at: tuple[float, float], frames: int, share: float = SHARE) -> HybridBelief:
    """After five views of a thing, and then ``frames`` in which there is a detection at another place, too."""
    configuration = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world={"second_box_share": share, "second_box_m": WIDTH_M, "least_undetected_share": 1.0},
    )
    engine = Engine(configuration)
    for k in range(5 + frames):
        seen = [Detection.at(*THING), *([Detection.at(*at)] if k >= 5 else [])]
        belief = engine.process(Keyframe.planar(k, detections=seen, motion_sigmas=(1e-3, 1e-3, 1e-3)))
    return belief


def test_a_second_box_beside_a_thing_is_doubted_and_one_elsewhere_is_as_before() -> None:
    beside, elsewhere = (existence_of_second(at, 1).existence[-1] for at in ((2.0, 0.3), (3.5, 1.0)))
    plain = existence_of_second((2.0, 0.3), 1, share=0.0).existence[-1]
    assert beside < plain - 0.2
    assert elsewhere == pytest.approx(plain, abs=0.02)


def test_the_existence_of_a_thing_beside_another_weighs_births_against_false_alarms_and_second_boxes() -> None:
    world = Configuration.of().open_world
    area = 0.5 * world.field_of_view_rad * (world.max_range_m**2 - world.min_range_m**2)
    beside, plain = (existence_of_second((2.0, 0.3), 1, share=share).existence[-1] for share in (SHARE, 0.0))
    clutter = world.clutter_per_frame / area
    born = clutter * plain / (1.0 - plain)
    second = born * (1.0 - beside) / beside - clutter
    widest = SHARE * world.detection_probability / (2.0 * np.pi * WIDTH_M**2)
    assert 0.3 * widest < second < widest  # 0.3 m away, places known to a decimetre or two


def test_two_things_that_stand_together_are_two_when_both_are_seen_again_and_again() -> None:
    belief = existence_of_second((2.0, 0.5), 6)
    assert len(belief.existence) == 2
    assert belief.existence.min() > 0.95


@pytest.mark.parametrize(("gone_s", "least"), [(0.0, 0.0), (36000.0, 0.9)])
def test_what_has_left_has_no_second_box(gone_s: float, least: float) -> None:
    """A detection beside a thing that has surely left in ten hours is of something else."""
    world = {"second_box_share": 0.3, "second_box_m": WIDTH_M, "departures_per_hour": 30.0, "clutter_per_frame": 0.1}
    world |= {"least_undetected_share": 1.0, "gate_sigma": 2.0}
    engine = Engine(Configuration.of(association="open", semantic_model={"kind": "none"}, open_world=world))
    still = (1e-5,) * 3
    for k in range(4):
        engine.process(Keyframe.planar(k, detections=[Detection.at(*THING)], motion_sigmas=still))
    stamp_ns = int((4.0 + gone_s) * 1e9)
    beside = Detection.at(2.0, 0.4, covariance=0.02**2 * np.eye(2))
    belief = engine.process(Keyframe.planar(4, detections=[beside], motion_sigmas=still, stamp_ns=stamp_ns))
    assert least <= belief.existence[-1] <= least + 0.5
