"""What a study leaves behind: result.json and one page that sets each claim beside what was measured."""

import json
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader

REQUIREMENT = "project requirement"
"""Source of the claims that the project makes of itself."""


@dataclass(frozen=True)
class Claim:
    """One statement, who made it, and whether it was seen to hold."""

    text: str
    source: str
    thesis: str  # what the source reports, "" where it reports no number
    measured: str
    holds: bool


def required(text: str, measured: str, holds: bool) -> Claim:
    """A claim that the project makes of itself."""
    return Claim(text, REQUIREMENT, "", measured, bool(holds))


@dataclass(frozen=True)
class Table:
    """Rows for the page."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Figure:
    """A picture for the page, which carries it inside."""

    title: str
    text: str  # what to see in it
    file: Path  # PNG

    @property
    def address(self) -> str:
        """The picture as a data URL."""
        return "data:image/png;base64," + b64encode(self.file.read_bytes()).decode("ascii")


def write_result(
    out: Path,
    result: dict[str, Any],
    claims: Sequence[Claim],
    tables: Sequence[Table],
    figures: Sequence[Figure] = (),
) -> list[Path]:
    """Write ``result`` with its claims to ``out``/result.json and a page beside it; returns both paths."""
    from semantic_slam.pipeline.provenance import machine

    out.mkdir(parents=True, exist_ok=True)
    full = {"schema_version": 1, **result, "machine": machine(), "claims": [asdict(claim) for claim in claims]}
    data, page = out / "result.json", out / "result.html"
    data.write_text(json.dumps(full, indent=1, allow_nan=False), encoding="utf-8")
    environment = Environment(loader=PackageLoader("semantic_slam_lab.studies"), autoescape=True)
    template = environment.get_template("study.html.jinja")
    page.write_text(template.render(result=full, claims=claims, tables=tables, figures=figures), encoding="utf-8")
    return [data, page]
