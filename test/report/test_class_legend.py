"""Legend of the classes: what shares a grey is named, too."""

from html.parser import HTMLParser
from pathlib import Path

import pytest
from worlds.belief_factory import CLASSES, write_belief_bag

from semantic_slam.report.make import make_report


class Legends(HTMLParser):
    """Names of the entries of each legend of classes."""

    def __init__(self) -> None:
        super().__init__()
        self.legends: list[list[str]] = []
        self.inside = False

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if dict(attributes).get("class") == "legend classes":
            self.inside = True
            self.legends.append([])

    def handle_endtag(self, tag: str) -> None:
        if tag == "p":
            self.inside = False

    def handle_data(self, data: str) -> None:
        if self.inside and data.strip():
            self.legends[-1].append(data)


@pytest.mark.parametrize(("more", "coloured", "rest"), [(0, 3, []), (5, 8, []), (7, 8, ["other classes"])])
def test_classes_beyond_the_eighth_have_an_entry_together(
    more: int, coloured: int, rest: list[str], tmp_path: Path
) -> None:
    names = (*CLASSES, *(f"thing {number}" for number in range(more)))
    beliefs, _ = write_belief_bag(tmp_path, 4, class_names=names)
    make_report(beliefs, tmp_path / "report")
    page = Legends()
    page.feed((tmp_path / "report" / "report.html").read_text())
    assert len(page.legends) == 2
    for legend in page.legends:
        assert len(legend) == coloured + len(rest) and legend[coloured:] == rest
