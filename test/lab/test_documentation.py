"""Generated pages equal what code and kept results say now, and the generator takes nothing on trust."""

import json
from pathlib import Path

import pytest
from semantic_slam_lab.documentation.build import outdated
from semantic_slam_lab.documentation.fill import filled
from semantic_slam_lab.documentation.headline import ROWS
from semantic_slam_lab.documentation.messages import read_definition
from semantic_slam_lab.documentation.parameters import parameters_page
from semantic_slam_lab.documentation.writing.kept_results import KeptResults, keep, read_kept
from semantic_slam_lab.documentation.writing.markdown import value

from semantic_slam.configuration import Configuration, to_dict
from semantic_slam.errors import InputError

ROOT = Path(__file__).parents[2]
KEPT = sorted((ROOT / "docs" / "results").glob("*.json"))


def test_no_page_is_out_of_date() -> None:
    assert [str(path.relative_to(ROOT)) for path in outdated(ROOT)] == [], "run make docs"


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_every_kept_result_says_where_it_comes_from(path: Path) -> None:
    result = json.loads(path.read_text(encoding="utf-8"))
    assert result["revision"] and "dirty" not in result["revision"]
    assert set(result["machine"]) == {"cpu", "cores", "python"}
    assert isinstance(result["quick"], bool)


def test_every_parameter_is_on_its_page() -> None:
    def names(values: dict[str, object], prefix: str = "") -> list[str]:
        nested = [names(v, f"{prefix}{k}.") if isinstance(v, dict) else [prefix + k] for k, v in values.items()]
        return [name for own in nested for name in own]

    page = parameters_page()
    assert [name for name in names(to_dict(Configuration())) if f"| `{name}` |" not in page] == []


def test_a_comment_that_goes_on_belongs_to_its_field(tmp_path: Path) -> None:
    path = tmp_path / "Box.msg"
    path.write_text(
        "# What a box is.\nfloat64[] sides   # S: metres,\n                 #    the longest first\nbool open\n"
    )
    found = read_definition(path)
    assert found.text == "What a box is."
    assert found.parts == [[["float64[]", "sides", "S: metres, the longest first"], ["bool", "open", ""]]]


def test_marked_values_are_replaced_and_the_rest_is_left() -> None:
    results = KeptResults({"drive": {"methods": {"ours": {"ate_m": 0.1234, "never": None}}}})
    text = "ATE <!-- value drive:methods/ours/ate_m .2f m -->9 m<!-- end -->, as said."
    assert "-->0.12 m<!-- end -->, as said." in filled(text, results, {})
    assert filled("<!-- table one -->\nold\n<!-- end -->", results, {"one": lambda _: "new\n"}).count("new") == 1
    with pytest.raises(InputError, match="no such result"):
        filled("<!-- value drive:methods/theirs -->1<!-- end -->", results, {})


def test_values_are_written_as_asked() -> None:
    assert [value(None), value(True), value(0.5, ".0%"), value(3.0, ".1f m")] == ["–", "yes", "50%", "3.0 m"]


def test_every_row_of_the_headline_tells_the_methods_apart() -> None:
    results = read_kept(ROOT / "docs" / "results")
    for _, ours, beside in (row.cells(results) for row in ROWS):
        assert any(own.rpartition(": ")[2] != ours.strip("*") for own in beside.split("; ")), (ours, beside)


def test_kept_results_leave_out_what_only_figures_need(tmp_path: Path) -> None:
    source = tmp_path / "result.json"
    result = {"study": "drive", "steps": {"a": [1.0]}, "methods": {"ours": {"x": 0.123456789, "all": [0.0] * 99}}}
    result |= {"network": str(tmp_path / "network.safetensors"), "topic": "/odom"}
    source.write_text(json.dumps(result))
    assert keep(source, tmp_path / "kept").name == "drive.json"
    kept = read_kept(tmp_path / "kept")
    assert kept.results["drive"] == {
        "study": "drive",
        "methods": {"ours": {"x": 0.123457}},
        "network": "network.safetensors",
        "topic": "/odom",
    }
    assert kept.at("drive:methods/ours/x") == 0.123457
