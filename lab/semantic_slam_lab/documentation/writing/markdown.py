"""Tables of Markdown."""

from collections.abc import Sequence


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with a heading row; cells may hold Markdown."""
    lines = [_row(columns), "|" + "---|" * len(columns), *(_row(row) for row in rows)]
    return "\n".join(lines) + "\n"


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell(text) for text in cells) + " |"


def cell(text: str) -> str:
    """Text that does not end its cell."""
    return " ".join(text.replace("|", "\\|").split())


def value(number: object, style: str = "") -> str:
    """A number in the style of :func:`format`; None as a dash, a truth value as yes or no, text as it is.

    A style may end in a unit after a blank: ``.2f m``.
    """
    if number is None:
        return "–"
    if isinstance(number, bool):
        return "yes" if number else "no"
    if isinstance(number, str):
        return number
    form, _, unit = style.partition(" ")
    return format(number, form) + (f" {unit}" if unit else "")
