"""Tables whose rows are methods and whose columns are metrics, as most results have them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from semantic_slam.errors import InputError
from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value


@dataclass(frozen=True)
class Column:
    """A metric: its heading, its key in a row, and how it is written."""

    heading: str
    key: str
    style: str = ".2f"


@dataclass(frozen=True, kw_only=True)
class MethodsTable:
    """Rows of one result; ``rows`` is address of a row -> its words."""

    study: str
    columns: Sequence[Column]
    rows: Mapping[str, str]
    first: str = ""
    """Heading of the first column."""

    def __call__(self, results: KeptResults) -> str:
        """Markdown; a metric that a method lacks is a dash. Raises InputError without the study."""
        headings = (self.first, *(column.heading for column in self.columns))
        return table(headings, [self._row(results, path, words) for path, words in self.rows.items()])

    def _row(self, results: KeptResults, path: str, words: str) -> list[str]:
        row = results.at(f"{self.study}:{path}")
        return [words, *(value(_metric(row, column.key), column.style) for column in self.columns)]


def _metric(row: object, key: str) -> object:
    try:
        return KeptResults({"row": {"row": row}}).at(f"row:row/{key}")
    except InputError:
        return None
