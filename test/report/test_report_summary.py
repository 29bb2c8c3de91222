"""Reports of many bags: one page beside the reports, and no bag's fault ends another's run."""

import html
import json
import shutil
import sys
from pathlib import Path

import pytest
from worlds.bags.bag_factory import write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.commands import call
from worlds.processes.installed import ROOT

from semantic_slam.cli.bag_to_report import main, parse
from semantic_slam.cli.many_reports import names_of, report_many
from semantic_slam.errors import InputError
from semantic_slam.report.metrics_table import MEANINGS
from semantic_slam.report.summary import SHOWN_METRICS, SummaryRow, summary_files

BAG = ROOT / "bags" / "standing.mcap"


@pytest.mark.long
def test_a_broken_bag_among_others_costs_its_own_report_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken, whole = tmp_path / "broken.mcap", write_bag(tmp_path / "whole", place_entries("ranges"))
    broken.write_bytes(b"no bag")
    out = tmp_path / "reports"
    words = [broken, whole, "--config", write_configuration(tmp_path / "configuration"), "--max-keyframes", 1]
    monkeypatch.setattr(sys, "argv", ["bag_to_report", *map(str, words), "--out", str(out)])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    told = capsys.readouterr().err
    assert "broken.mcap: no mcap file" in told and "1 of 2 bags went wrong: broken; see" in told
    assert (out / "whole" / "report.html").is_file() and not (out / "broken").exists()
    rows = {row["name"]: row for row in json.loads((out / "summary.json").read_text())["bags"]}
    assert rows["whole"]["keyframes"] == 1 and rows["whole"]["fault"] == ""
    assert rows["broken"]["keyframes"] is None and "no mcap file" in rows["broken"]["fault"]
    assert 'href="whole/report.html"' in (out / "index.html").read_text()


@pytest.mark.long
def test_a_bag_that_fails_is_not_shown_with_what_an_earlier_run_found(tmp_path: Path) -> None:
    broken = [tmp_path / f"{name}.mcap" for name in "ab"]
    for bag in broken:
        bag.write_bytes(b"no bag")
        folder = tmp_path / "out" / bag.stem
        folder.mkdir(parents=True)
        (folder / "report.json").write_text("{}")
    with pytest.raises(InputError, match="2 of 2 bags went wrong"):
        report_many(parse([*map(str, broken), "--out", str(tmp_path / "out"), "--overwrite", "--jobs", "2"]))
    rows = json.loads((tmp_path / "out" / "summary.json").read_text())["bags"]
    assert [row["keyframes"] for row in rows] == [None, None]


def test_a_summary_that_is_there_is_not_replaced_unasked(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("mine")
    arguments = parse([str(BAG), str(ROOT / "bags" / "aliased_room"), "--out", str(tmp_path)])
    with pytest.raises(InputError, match=r"index.html: exists already; give --overwrite"):
        report_many(arguments)
    assert not (tmp_path / "standing").exists()


def test_bags_of_one_name_are_told_by_the_folders_that_they_lie_in(tmp_path: Path) -> None:
    bags = [tmp_path / day / "drive.mcap" for day in ("monday", "tuesday")]
    assert names_of([*bags, BAG]) == {"monday_drive": bags[0], "tuesday_drive": bags[1], "standing": BAG}
    assert list(names_of([tmp_path / "run.1", tmp_path / "run.2"])) == ["run.1", "run.2"]
    with pytest.raises(InputError, match="two bags would share this report folder"):
        names_of([tmp_path / "here" / "monday" / "drive", bags[0]])


def test_what_a_bag_is_called_is_text_on_the_page() -> None:
    row = SummaryRow(name="<b>x</b>", bag="x", fault="<script>", metrics={"ate_aligned_m": None})
    page = summary_files([row])["index.html"]
    assert "&lt;b&gt;x&lt;/b&gt;" in page and "<b>x</b>" not in page and "&lt;script&gt;" in page


def test_a_metric_of_the_summary_says_by_itself_what_it_is() -> None:
    row = SummaryRow(name="drive", bag="x", fault="", metrics=dict.fromkeys(SHOWN_METRICS, 0.5))
    page = html.unescape(summary_files([row])["index.html"])
    for name in SHOWN_METRICS:
        assert f'title="{MEANINGS[name]}">{name}</th>' in page
    assert not [text for text in MEANINGS.values() if "that path" in text or "the same" in text]


@pytest.mark.long
@pytest.mark.slow
def test_bags_go_to_the_cluster_of_a_scheduler(tmp_path: Path) -> None:
    from distributed import LocalCluster

    bags = [write_bag(tmp_path / name, place_entries("ranges")) for name in ("one", "two")]
    configuration = write_configuration(tmp_path / "configuration")
    words = [*map(str, bags), "--config", str(configuration), "--max-keyframes", "1", "--out", str(tmp_path / "out")]
    with LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as cluster:
        files = report_many(parse([*words, "--scheduler", cluster.scheduler_address]))
        (worker,) = cluster.workers.values()
        assert worker.state.executed_count == 2
    assert [path.name for path in files] == ["index.html", "summary.json"]
    rows = json.loads((tmp_path / "out" / "summary.json").read_text())["bags"]
    assert [(row["name"], row["keyframes"], row["fault"]) for row in rows] == [("one", 1, ""), ("two", 1, "")]
    assert all((tmp_path / "out" / row["name"] / "report.html").is_file() for row in rows)


def test_a_single_bag_says_that_no_scheduler_gets_it(tmp_path: Path) -> None:
    result = call(tmp_path, "semantic_slam.cli.bag_to_report", "no.mcap", "--out", "out", "--scheduler", "tcp://a:1")
    assert (result.returncode, result.stdout) == (2, "--scheduler has no effect: a single bag is run here\n")


def test_without_a_scheduler_at_its_address_nothing_is_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("semantic_slam.cluster.CONNECT_TIMEOUT", "1s")
    shutil.copy(BAG, tmp_path / "again.mcap")
    words = [str(BAG), str(tmp_path / "again.mcap"), "--out", str(tmp_path / "out"), "--scheduler", "tcp://127.0.0.1:9"]
    with pytest.raises(InputError, match="no Dask scheduler"):
        report_many(parse(words))
