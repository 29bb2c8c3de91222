"""Tables of an explanation: rows of text, the header first."""

import numpy as np

from semantic_slam.answers.explain.explanation import Explanation, HistoryExplained
from semantic_slam.answers.explain.ledger import PairLedger
from semantic_slam.answers.explain.replayed_run import enumerates_classes
from semantic_slam.answers.explain.sightings import Sighting
from semantic_slam.geometry.arrays import Array

MOST_RIVALS = 12
"""Largest number of alternatives in the table."""
MOST_HISTORIES = 5
DOUBTS = ("no object", "model [nats]", "outlier")
COLUMNS = (
    "keyframe",
    "assigned to",
    "could be",
    "then",
    "now",
    "dropped in",
    "before [nats]",
    "behind [nats]",
)


def views_table(explanation: Explanation, own: HistoryExplained) -> list[list[str]]:
    """Header, then rows for the prior, each view, the revision and the sum; empty columns are dropped.

    Without class models only the views.
    """
    pair = own.pair
    if pair is None or explanation.classes is None:
        rows = [_view_row(view, "", "", "") for view in own.views]
        return _filled([["keyframe", "from [deg]", "range [m]", "", "", "", *DOUBTS], *rows])
    one, other = (explanation.belief.class_names[cls] for cls in explanation.classes)
    header = ["keyframe", "from [deg]", "range [m]", f"{one}:{other}", "log odds", "view alone"]
    rows = [["prior", "", "", f"{pair.prior:+.3f}", f"{pair.prior:+.3f}", "", "", "", ""]]
    total, shown, alone = pair.prior, set[int](), explanation.alone(own)
    index = {keyframe.belief.keyframe: k for k, keyframe in enumerate(explanation.run.keyframes)}
    for view, by_itself in zip(own.views, alone.tolist(), strict=True):
        k = index[view.keyframe]
        gained = np.nan if k in shown else pair.last_nats if k == pair.until + 1 else float(pair.views[k])
        shown.add(k)
        total += gained
        beside = (
            _signed(by_itself) if enumerates_classes(explanation.run.problem) else ""
        )  # else it equals the view's own contribution
        rows.append(_view_row(view, _signed(gained), _signed(total), beside))
    rows.append(["earlier views revised", "", "", f"{pair.revised:+.3f}", "", "", "", "", ""])
    rows.append([*_end(explanation, pair), "", "", "", ""])
    return _filled([[*header, *DOUBTS], *rows])


def _end(explanation: Explanation, pair: PairLedger) -> list[str]:
    """Row with the sum of the rows above."""
    if pair.is_pruned:
        at = explanation.run.keyframes[pair.until + 1].belief.keyframe
        end = "dropped in" if pair.was_weighed else "not considered from"
        return [f"{end} keyframe {at}, at", "", "", "", f"{pair.gone:+.3f}"]
    return [f"log odds after keyframe {explanation.belief.keyframe}", "", "", "", f"{pair.log_odds:+.3f}"]


def _view_row(view: Sighting, gained: str, total: str, alone: str) -> list[str]:
    doubts = [_plain(view.no_object), _plain(view.mutual_information), _plain(view.outlier)]
    return [str(view.keyframe), view.degrees, f"{view.range_m:.2f}", gained, total, alone, *doubts]


def histories_table(explanation: Explanation) -> list[list[str]]:
    """Header, a row per association history in the last belief, and one for all of them."""
    header = ["history", "weight", "views", *(f"P({name})" for name in explanation.belief.class_names)]
    rows = [
        [str(1 + number), f"{own.weight:.4f}", str(len(own.views)), *_probabilities(np.exp(own.ledger.log_posterior))]
        for number, own in enumerate(explanation.histories[:MOST_HISTORIES])
    ]
    others = explanation.histories[MOST_HISTORIES:]
    rest = [[f"{len(others)} more", f"{sum(own.weight for own in others):.4f}"]] if others else []
    everything = ["belief", "1.0000", "", *_probabilities(explanation.belief.class_probabilities[explanation.row])]
    return [header, *rows, *([*row, *[""] * (len(header) - 2)] for row in rest), everything]


def rivals_table(explanation: Explanation, own: HistoryExplained) -> list[list[str]]:
    """Header, and a row per most likely alternative."""
    if not own.rivals:
        return []
    chosen = sorted(own.rivals, key=lambda rival: -rival.then)[:MOST_RIVALS]
    rows = [
        [
            str(rival.keyframe),
            explanation.name_of(rival.taken_id),
            explanation.name_of(rival.object_id),
            f"{rival.then:.4f}",
            f"{rival.now:.4f}",
            "-" if rival.gone is None else str(rival.gone),
            _plain(-rival.log_odds_before),
            _plain(-rival.log_odds),
            ", ".join(rival.by) if rival.gone is not None else "",
        ]
        for rival in sorted(chosen, key=lambda rival: (rival.keyframe, rival.detection, -rival.then))
    ]
    return [[*COLUMNS, "seen then"], *rows]


def _signed(value: float) -> str:
    return f"{value:+.3f}" if np.isfinite(value) else "-"


def _plain(value: float) -> str:
    return f"{abs(value) if value == 0.0 else value:.3f}" if np.isfinite(value) else "-"


def _probabilities(values: Array) -> list[str]:
    return [f"{value:.4f}" for value in values.tolist()]


def _filled(rows: list[list[str]]) -> list[list[str]]:
    """Drop columns without content; the first row is the header."""
    columns = [column for column in zip(*rows, strict=True) if set(column[1:]) - {"", "-"}]
    return [list(row) for row in zip(*columns, strict=True)]
