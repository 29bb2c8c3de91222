"""The latent space in a report, and on its way into a later run's map prior."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import OBJECTS, write_belief_bag

from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.inference.world.map_prior import MapPrior, parse_map_prior
from semantic_slam.report.comparison import Run
from semantic_slam.report.document import Analysis, analyse, map_prior, report_document
from semantic_slam.report.page import render_page
from semantic_slam.report.shown.descriptors import descriptor_figures, main_axes, plane_svg, strips_svg

LENGTH = 4
MEAN = np.random.default_rng(3).normal(size=(len(OBJECTS), LENGTH))


@pytest.fixture(scope="module")
def analysis(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    beliefs, _ = write_belief_bag(tmp_path_factory.mktemp("latent"), 8)
    record = read_record(beliefs)
    last = dataclasses.replace(record.beliefs[-1], descriptors=MEAN, descriptor_covariances=np.full(MEAN.shape, 0.04))
    return analyse(dataclasses.replace(record, beliefs=(*record.beliefs[:-1], last)), beliefs, "0" * 64)


def test_the_page_shows_the_latent_space(analysis: Analysis) -> None:
    page = render_page([Run("latent", analysis)], None)
    assert "The latent space" in page and "descriptors of" in page and "map of the latent space" in page
    figures = descriptor_figures(analysis)
    assert figures is not None and figures.plane is not None
    seen = sum(1 for n in analysis.record.beliefs[-1].object_ids if analysis.detection_counts[int(n)])
    assert figures.strips.count("<rect") == LENGTH * seen
    assert figures.plane.count("<ellipse") == seen
    assert 0.5 < figures.share <= 1.0


def test_a_run_without_descriptors_shows_none(analysis: Analysis) -> None:
    record, none = analysis.record, np.zeros((len(OBJECTS), 0))
    last = dataclasses.replace(record.beliefs[-1], descriptors=none, descriptor_covariances=none)
    bare = dataclasses.replace(analysis, record=dataclasses.replace(record, beliefs=(*record.beliefs[:-1], last)))
    assert descriptor_figures(bare) is None
    assert "The latent space" not in render_page([Run("plain", bare)], None)


def test_main_axes_are_those_of_largest_variance() -> None:
    """Points on a line along (3, 4, 0) with little noise along z: the first axis is the line, the share nearly 1."""
    along = np.linspace(-1.0, 1.0, 9)
    points = np.outer(along, [0.6, 0.8, 0.0])
    points[:, 2] = 0.01 * along**2
    axes, share = main_axes(points)
    np.testing.assert_allclose(np.abs(axes[:, 0]), [0.6, 0.8, 0.0], atol=1e-2)
    assert share > 0.999


def test_labels_are_escaped() -> None:
    for picture in (
        strips_svg(MEAN, np.ones_like(MEAN), ["<script>"] * len(MEAN)),
        plane_svg(MEAN[:, :2], np.tile(np.eye(2), (len(MEAN), 1, 1)), ["<script>"] * len(MEAN), ["#fff"] * len(MEAN)),
    ):
        assert "<script>" not in picture and "&lt;script&gt;" in picture


def test_objects_json_carries_descriptors_to_the_next_run(analysis: Analysis, tmp_path: Path) -> None:
    settings = json.dumps({"semantic_model": {"kind": "latent", "space": "latent-0123"}})
    run = dataclasses.replace(analysis.record.run, configuration=settings)
    prior: MapPrior = map_prior(dataclasses.replace(analysis.record, run=run))
    again = parse_map_prior(prior.to_json(), "objects.json")
    assert again.descriptor_space == "latent-0123"
    np.testing.assert_allclose(again.objects[2].descriptor, MEAN[2])
    np.testing.assert_allclose(again.objects[2].descriptor_variance, 0.04)
    rows = report_document(analysis)["objects"]
    np.testing.assert_allclose(rows[1]["descriptor"], MEAN[1])


def test_half_a_descriptor_is_refused() -> None:
    row = (
        '{"id": 1, "pose": [0,0,0,0,0,0,1], "covariance": [' + ",".join(["0"] * 36) + '], "descriptor": [1.0, 2.0],'
        ' "descriptor_variance": [1.0]}'
    )
    with pytest.raises(InputError, match="as many positive variances"):
        parse_map_prior(f'{{"objects": [{row}]}}', "objects.json")
