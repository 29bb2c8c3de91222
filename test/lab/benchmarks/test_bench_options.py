"""What options cost: every switch turns on something that is shipped, and the interval is that of a bootstrap."""

import numpy as np
import pytest
from semantic_slam_lab.benchmarks.option_costs import ALL, OPTIONS, bare_configuration, interval

from semantic_slam.configuration import load_configuration
from semantic_slam.shipped import configuration_file


def test_each_option_changes_what_has_none_and_all_of_them_are_what_is_shipped() -> None:
    shipped = load_configuration(configuration_file("uncalibrated"))
    bare = bare_configuration(shipped)
    switched = {name: switch(bare, shipped) for name, switch in OPTIONS.items()}
    assert len({repr(own) for own in (bare, *switched.values())}) == 1 + len(OPTIONS)
    assert switched[ALL].open_world == shipped.open_world and switched[ALL].pruning == bare.pruning


def test_the_interval_of_a_ratio_is_narrow_where_the_ratio_is_the_same_everywhere_and_holds_the_mean() -> None:
    random = np.random.default_rng(0)
    peer = random.uniform(1.0, 2.0, size=40)
    assert interval(3.0 * peer, peer, random) == pytest.approx((3.0, 3.0))
    noisy = 3.0 * peer + random.normal(0.0, 0.5, size=40)
    low, high = interval(noisy, peer, random)
    assert low < noisy.sum() / peer.sum() < high and high - low < 0.5
