"""Tables of the pages scroll by themselves: none makes a page wider than its screen."""

import re
from html.parser import HTMLParser
from importlib.resources import files

import pytest

TEMPLATES = files("semantic_slam.report") / "templates"
PAGES = sorted(entry.name for entry in TEMPLATES.iterdir() if "<table" in entry.read_text(encoding="utf-8"))


class Tables(HTMLParser):
    """Class of the element that holds each table."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.holders: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self.holders.append(self.open[-1])
        if tag in ("div", "section", "details"):
            self.open.append(dict(attributes).get("class") or "")

    def handle_endtag(self, tag: str) -> None:
        if tag in ("div", "section", "details"):
            self.open.pop()


@pytest.mark.parametrize("page", PAGES)
def test_every_table_of_a_page_scrolls_by_itself(page: str) -> None:
    tables = Tables()
    tables.feed(re.sub(r"{[%{#].*?[%}#]}", "", (TEMPLATES / page).read_text(encoding="utf-8")))
    assert tables.holders and set(tables.holders) == {"scroll"}
    assert ".scroll { overflow-x: auto; }" in (TEMPLATES / "report.css").read_text(encoding="utf-8")
