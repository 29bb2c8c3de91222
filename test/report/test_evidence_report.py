"""A report that was asked for evidence opens an account of every object: views with pictures, nats and rivals."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from worlds.bags.bag_factory import input_entries, of_topic, write_bag

from semantic_slam.configuration import Configuration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message, to_message
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.report.make import make_report

NUM_FRAMES = 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive past a chair and a cup, with pictures, and its belief."""
    out = tmp_path_factory.mktemp("evidence")
    entries = input_entries(NUM_FRAMES)
    for entry in of_topic(entries, topics.DETECTIONS):
        found = from_message(entry.message)
        entry.message = to_message(replace(found, labels=("chair", "<i>cup")))
    settings = Configuration.of(
        association="open", semantic_model={"kind": "detector"}, perception={"network": "nowhere.safetensors"}
    )
    run_bag(write_bag(out / "input", entries), out / "belief", settings)
    return out


def test_every_object_has_an_account_with_pictures_of_its_views(folder):
    make_report(folder / "belief", folder / "with", folder / "input", with_evidence=True)
    page = (folder / "with" / "report.html").read_text(encoding="utf-8")
    accounts = re.findall(r'<details id="why-(\d+)">(.*?)</details>', page, re.DOTALL)
    assert len(accounts) == 2
    for _, account in accounts:
        assert account.count("<p>") == 3 and account.count('<img class="crop"') == NUM_FRAMES
        assert "<td>prior</td>" in account and "<td>earlier views revised</td>" in account
    assert "The replay reproduces the recorded beliefs" in page and "<i>cup" not in page
    assert '"#why-" + about.id' in page and "--explain" not in page


def test_nothing_is_inferred_anew_where_nobody_asks(folder):
    make_report(folder / "belief", folder / "without", folder / "input")
    page = (folder / "without" / "report.html").read_text(encoding="utf-8")
    assert 'id="evidence"' not in page
    assert "A report made with <code>--explain</code> says of each object why" in page
