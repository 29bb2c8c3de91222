"""Values and tables inside pages that are otherwise written by hand, between comments that a reader does not see.

``<!-- value study:path .2f m -->0.24 m<!-- end -->`` within a line, ``<!-- table name -->`` ... ``<!-- end -->`` around
a table.
"""

import re
from collections.abc import Callable, Mapping

from semantic_slam.errors import InputError
from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import value

VALUE = re.compile(r"(<!-- value (?P<address>[^\s>]+)(?: (?P<style>[^>]+?))? -->)(?:[^<]*)(<!-- end -->)")
TABLE = re.compile(r"(<!-- table (?P<name>\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

Tables = Mapping[str, Callable[[KeptResults], str]]


def filled(text: str, results: KeptResults, tables: Tables) -> str:
    """``text`` with every marked value and table as the results have it now. Raises InputError for an unknown one."""

    def value_of(match: re.Match[str]) -> str:
        return f"{match[1]}{value(results.at(match['address']), match['style'] or '')}<!-- end -->"

    def table_of(match: re.Match[str]) -> str:
        if match["name"] not in tables:
            raise InputError(f"table {match['name']}: there is none; known are {', '.join(sorted(tables))}")
        return f"{match[1]}{tables[match['name']](results)}<!-- end -->"

    return TABLE.sub(table_of, VALUE.sub(value_of, text))
