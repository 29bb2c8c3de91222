"""What options cost: they are the options that are shipped, and the interval is that of a bootstrap."""

from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from semantic_slam_lab.benchmarks.option_costs import ALL, OPTIONS, bare_configuration, interval

from semantic_slam.configuration import MovingConfiguration, load_configuration
from semantic_slam.shipped import configuration_file

NOT_SHIPPED = ("outliers", "moving_objects")


def test_all_options_one_after_the_other_are_what_is_shipped_but_for_what_goes_by_labels() -> None:
    shipped = load_configuration(configuration_file("uncalibrated"))
    bare = bare_configuration(shipped)
    alone = {name: own.switch(bare, shipped) for name, own in OPTIONS.items()}
    assert len({repr(own) for own in (bare, *alone.values())}) == 1 + len(OPTIONS)
    others = [own for name, own in OPTIONS.items() if name not in (ALL, *NOT_SHIPPED)]
    together = reduce(lambda base, own: own.switch(base, shipped), others, bare)
    unlabelled = replace(shipped.open_world, departures_by_label=())
    assert together == replace(alone[ALL], open_world=unlabelled, moving=MovingConfiguration())


def test_the_interval_of_a_ratio_is_narrow_where_the_ratio_is_the_same_everywhere_and_holds_the_mean() -> None:
    random = np.random.default_rng(0)
    peer = random.uniform(1.0, 2.0, size=40)
    assert interval(3.0 * peer, peer, random) == pytest.approx((3.0, 3.0))
    noisy = 3.0 * peer + random.normal(0.0, 0.5, size=40)
    low, high = interval(noisy, peer, random)
    assert low < noisy.sum() / peer.sum() < high and high - low < 0.5
