"""What the page of results says of one study."""

from collections.abc import Callable
from dataclasses import dataclass

from semantic_slam_lab.documentation.writing.kept_results import KeptResults

TableOf = Callable[[KeptResults], str]


@dataclass(frozen=True)
class Section:
    """A title, a sentence or two, and tables with their captions, "" for none."""

    study: str
    title: str
    text: str
    tables: tuple[tuple[str, TableOf], ...] = ()
    command: str = ""  # that runs it; "": run_study
