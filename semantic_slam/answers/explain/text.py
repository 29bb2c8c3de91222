"""An explanation as plain text: sentences, and tables."""

from semantic_slam.answers.explain.explanation import Explanation
from semantic_slam.answers.explain.sentences import sentences
from semantic_slam.answers.explain.tables import MOST_RIVALS, histories_table, rivals_table, views_table


def lines_of(explanation: Explanation, history: int = 0) -> list[str]:
    """Lines of the printed explanation; ``history``: index of the history, from 0."""
    own = explanation.histories[history]
    left = len(own.rivals) - MOST_RIVALS
    omitted = [f"({left} less probable ones are not shown)"] if left > 0 else []
    parts = [
        sentences(explanation, own),
        _aligned(views_table(explanation, own)),
        _aligned(histories_table(explanation)),
        [*_aligned(rivals_table(explanation, own)), *omitted],
    ]
    return [*"\n\n".join("\n".join(part) for part in parts if part).splitlines(), "", replay_line(explanation)]


def replay_line(explanation: Explanation) -> str:
    """Line that says whether the replay reproduces the run's numbers."""
    difference = explanation.run.largest_difference
    if explanation.run.is_same:
        return f"The replay reproduces the recorded beliefs{f' to within {difference:.0e} nats' if difference else ''}."
    return (
        f"These numbers are of a replay that differs from the recorded beliefs by up to {difference:.1e} nats; explain"
        " with the version that recorded the bag to reproduce its own."
    )


def _aligned(rows: list[list[str]]) -> list[str]:
    """Align columns to the right, the first one to the left."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    lines = [[row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))] for row in rows]
    return ["  ".join(line).rstrip() for line in lines]
