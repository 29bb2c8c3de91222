"""What a report says of the noise that beliefs have inferred."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import small_belief, with_noise, write_belief_bag

from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.report.document import noise_row
from semantic_slam.report.drawing.noise_charts import noise_charts, noise_course
from semantic_slam.report.make import make_report

BIAS, REACH = "odometry.bias_scale", "open_world.max_range_m"


def told(keyframe: int, noise: dict[str, tuple[float, float]]) -> HybridBelief:
    """A belief that names these values and standard deviations."""
    return with_noise(small_belief(keyframe, [1], [0], [1.0], [1], [[0]]), noise)


BELIEFS = (
    told(0, {BIAS: (0.0, 0.05)}),
    told(1, {BIAS: (0.01, 0.03), REACH: (4.0, np.nan)}),
    told(2, {BIAS: (0.02, 0.01), REACH: (5.0, np.nan)}),
)


def test_each_quantity_has_a_chart_and_a_band_where_it_has_a_spread() -> None:
    bias, reach = noise_charts(BELIEFS)
    assert (bias.title, reach.title) == (BIAS, REACH)
    assert bias.keys[0].values == [0.0, 0.01, 0.02]
    np.testing.assert_array_equal(reach.keys[0].values, [np.nan, 4.0, 5.0])
    assert "<polygon" in bias.svg and "standard deviation" in bias.text
    assert "<polygon" not in reach.svg and "standard deviation" not in reach.text


def test_the_band_is_one_standard_deviation_each_way() -> None:
    values, sigmas = noise_course(BELIEFS, BIAS)
    np.testing.assert_array_equal([values, sigmas], [[0.0, 0.01, 0.02], [0.05, 0.03, 0.01]])


def drawn_low(name: str, value: float, sigma: float) -> float:
    """Ordinate on the page [px, downwards] to which the band of a quantity reaches."""
    (chart,) = noise_charts(tuple(told(k, {name: (value, sigma)}) for k in range(2)))
    plot = re.search(r'<polygon[^>]* points="([^"]*)"', str(chart.svg))
    assert plot is not None
    return max(float(point.split(",")[1]) for point in plot[1].split())


def test_the_band_of_what_cannot_be_negative_ends_at_zero() -> None:
    """The scale of the plot begins there, too, so that the band reaches its lower edge; that of a bias does not."""
    clutter, bias = drawn_low("open_world.clutter_per_frame", 0.1, 0.3), drawn_low(BIAS, 0.1, 0.3)
    edge = drawn_low("open_world.clutter_per_frame", 0.1, 0.1)
    assert clutter == edge > bias


def test_an_infinite_mean_is_left_out_of_the_chart() -> None:
    half_range = "open_world.detection_half_range_m"
    beliefs = (told(0, {half_range: (np.inf, np.nan)}), told(1, {half_range: (3.0, 0.5)}))
    (chart,) = noise_charts(beliefs)
    np.testing.assert_array_equal(chart.keys[0].values, [np.nan, 3.0])
    assert "nan" not in chart.svg and "inf" not in chart.svg
    assert noise_charts(beliefs[:1]) == []


def test_a_density_is_per_square_metre_in_the_plane_and_per_cubic_metre_in_space() -> None:
    belief = told(0, {"open_world.birth_density": (0.2, 0.1)})
    texts = [noise_charts((dataclasses.replace(belief, planar=planar),))[0].text for planar in (True, False)]
    assert "Objects per square metre" in texts[0] and "Objects per cubic metre" in texts[1]


def test_the_document_has_the_final_values() -> None:
    row = noise_row(BELIEFS[-1])
    assert row[BIAS] == {"value": 0.02, "sigma": 0.01} and row[REACH]["value"] == 5.0
    assert noise_row(told(0, {})) == {}


@pytest.mark.parametrize("is_told", [True, False])
def test_the_page_has_a_section_only_where_there_is_something(tmp_path: Path, is_told: bool) -> None:
    beliefs, source = write_belief_bag(tmp_path, keyframes=6, noise={BIAS: (0.02, 0.01)} if is_told else {})
    assert len(read_record(beliefs).beliefs[-1].noise_names) == is_told
    make_report(beliefs, tmp_path / "report", source)
    page = (tmp_path / "report" / "report.html").read_text()
    assert ("What was inferred of the noise" in page) == is_told
    assert (f"<b>{BIAS}</b>" in page) == is_told
