"""An explanation in words: three sentences, and tables of plain text."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.answers.explain.explanation import Explanation, HistoryExplained
from semantic_slam.answers.explain.ledger import PairLedger
from semantic_slam.answers.explain.replayed_run import enumerates_classes
from semantic_slam.answers.explain.rivals import Rival
from semantic_slam.answers.explain.sightings import Sighting, object_name

MOST_RIVALS = 12
"""Alternatives in the table, the most probable ones."""
MOST_HISTORIES = 5
DOUBTS = ("no object", "model [nats]", "outlier")
LITTLE_NATS = 0.25
"""Views that tell less between two classes than this are said to tell them hardly apart."""
OUTLIER = 0.5
"""Probability from which on a view is said to be judged an outlier."""


def lines_of(told: Explanation, history: int = 0) -> list[str]:
    """All that is printed; ``history``: which of the explanation's, from 0 on."""
    own = told.histories[history]
    left = len(own.rivals) - MOST_RIVALS
    parts = [
        sentences(told, own),
        _aligned(views_table(told, own)),
        _aligned(histories_table(told)),
        [*_aligned(rivals_table(told, own)), *([f"({left} less probable ones are not shown)"] if left > 0 else [])],
    ]
    return [*"\n\n".join("\n".join(part) for part in parts if part).splitlines(), "", replay_line(told)]


def sentences(told: Explanation, own: HistoryExplained) -> list[str]:
    """What is believed and what else it might be; which views said so; which object they were of."""
    return [_belief(told, own), _views(told, own), _association(told, own)]


def _belief(told: Explanation, own: HistoryExplained) -> str:
    if told.classes is None or own.pair is None:
        return (
            f"{told.name} exists with probability {told.belief.existence[told.row]:.4f}; the run has no class models."
        )
    one, other = (told.belief.class_names[cls] for cls in told.classes)
    probability = told.belief.class_probabilities[told.row, told.classes[0]]
    begin = f"{told.name} is of class {one} with probability {probability:.4f}"
    if not own.pair.is_pruned:
        return f"{begin}; {other} is left with log odds of {own.pair.log_odds:+.2f} nats for {one}."
    at = told.run.keyframes[own.pair.until + 1].belief.keyframe
    if not own.pair.was_weighed:
        return f"{begin}; {other} was not weighed in keyframe {at} any more (weights.gate, weights.max_candidates)."
    return f"{begin}; {other} was given up in keyframe {at} at log odds of {own.pair.gone:+.2f} nats for {one}."


def _views(told: Explanation, own: HistoryExplained) -> str:
    if not own.views:
        return "It was never seen; what is believed of it is what the map said."
    spread = f"{len(own.views)} views {_directions(own.views)}"
    trust = _trust(own.views)
    if own.pair is None or told.classes is None:
        return f"It was seen in {spread}: {trust}."
    alone = _alone(told, own)
    most = int(np.argmax(np.abs(np.nan_to_num(alone))))
    told_most, little = own.views[most], int((np.abs(alone) < LITTLE_NATS).sum())
    one, other = (told.belief.class_names[cls] for cls in told.classes)
    return (
        f"Of {spread} the one of keyframe {told_most.keyframe} said most between {one} and {other} ({alone[most]:+.2f}"
        f" nats, from {_degrees(told_most)} deg at {told_most.range_m:.1f} m), and {little} hardly tell them apart;"
        f" {trust}."
    )


def _trust(views: Sequence[Sighting]) -> str:
    """How far the views are to be trusted."""
    strange, last = sum(not view.in_coverage for view in views), views[-1].mutual_information
    told = [f"{strange} outside what the class models know"]
    if np.isfinite([view.outlier for view in views]).any():
        told.insert(0, f"{sum(view.outlier > OUTLIER for view in views)} judged outliers")
    if np.isfinite(last):
        told.append(f"model uncertainty {last:.3f} nats at the last one")
    return ", ".join(told)


def _association(told: Explanation, own: HistoryExplained) -> str:
    if not own.rivals:
        return "None of its views might have been of another object."
    count = len({(rival.keyframe, rival.detection) for rival in own.rivals})
    likeliest = max(own.rivals, key=lambda rival: rival.then)
    last = max(own.rivals, key=lambda rival: (rival.gone is None, rival.gone or 0, rival.log_odds))
    begin = (
        f"{count} of its views might have been of something else, most of all that of keyframe {likeliest.keyframe}, of"
        f" {_rival_name(told, likeliest)} with probability {likeliest.then:.2f} then"
    )
    end = f"{begin}, {_ended(likeliest)}"
    if last == likeliest:
        return f"{end}."
    return (
        f"{end}; that of keyframe {last.keyframe} was the last in doubt, for {_rival_name(told, last)}, {_ended(last)}."
    )


def _ended(rival: Rival) -> str:
    """How an alternative ended."""
    if rival.gone is None:
        return f"and {rival.now:.4f} now"
    seen = " and ".join(rival.by) or "nothing"
    if not np.isfinite(rival.log_odds):
        return f"given up in keyframe {rival.gone}, when nothing continued it; {seen} {_was(rival)} seen"
    return (
        f"given up in keyframe {rival.gone}, {-rival.log_odds:.1f} nats behind the best, when {seen} {_was(rival)} seen"
    )


def _was(rival: Rival) -> str:
    return "were" if len(rival.by) > 1 else "was"


def views_table(told: Explanation, own: HistoryExplained) -> list[list[str]]:
    """Header, and a row for what was known before, each view, what was revised, and the sum, in columns with content.

    Without class models the views alone.
    """
    pair = own.pair
    if pair is None or told.classes is None:
        rows = [_view_row(view, "", "", "") for view in own.views]
        return _filled([["keyframe", "from [deg]", "range [m]", "", "", "", *DOUBTS], *rows])
    one, other = (told.belief.class_names[cls] for cls in told.classes)
    header = ["keyframe", "from [deg]", "range [m]", f"{one}:{other}", "log odds", "view alone"]
    rows = [["prior", "", "", f"{pair.prior:+.3f}", f"{pair.prior:+.3f}", "", "", "", ""]]
    total, shown, alone = pair.prior, set[int](), _alone(told, own)
    index = {keyframe.belief.keyframe: k for k, keyframe in enumerate(told.run.keyframes)}
    for view, by_itself in zip(own.views, alone.tolist(), strict=True):
        k = index[view.keyframe]
        gained = np.nan if k in shown else pair.last_nats if k == pair.until + 1 else float(pair.views[k])
        shown.add(k)
        total += gained
        beside = (
            _signed(by_itself) if enumerates_classes(told.run.problem) else ""
        )  # else that is what the view brought
        rows.append(_view_row(view, _signed(gained), _signed(total), beside))
    rows.append(["earlier views revised", "", "", f"{pair.revised:+.3f}", "", "", "", "", ""])
    rows.append([*_end(told, pair), "", "", "", ""])
    return _filled([[*header, *DOUBTS], *rows])


def _end(told: Explanation, pair: PairLedger) -> list[str]:
    """What the rows above add up to."""
    if pair.is_pruned:
        at = told.run.keyframes[pair.until + 1].belief.keyframe
        end = "given up" if pair.was_weighed else "not weighed any more"
        return [f"{end} in keyframe {at} at", "", "", "", f"{pair.gone:+.3f}"]
    return [f"log odds after keyframe {told.belief.keyframe}", "", "", "", f"{pair.log_odds:+.3f}"]


def _view_row(view: Sighting, gained: str, total: str, alone: str) -> list[str]:
    doubts = [_plain(view.no_object), _plain(view.mutual_information), _plain(view.outlier)]
    return [str(view.keyframe), _degrees(view), f"{view.range_m:.2f}", gained, total, alone, *doubts]


def histories_table(told: Explanation) -> list[list[str]]:
    """Header, and a row for each history of associations in the last belief, and one for all of them."""
    header = ["history", "weight", "views", *(f"P({name})" for name in told.belief.class_names)]
    rows = [
        [str(1 + number), f"{own.weight:.4f}", str(len(own.views)), *_probabilities(np.exp(own.ledger.log_posterior))]
        for number, own in enumerate(told.histories[:MOST_HISTORIES])
    ]
    left = sum(own.weight for own in told.histories[MOST_HISTORIES:])
    rest = [[f"{len(told.histories) - MOST_HISTORIES} more", f"{left:.4f}"]] if told.histories[MOST_HISTORIES:] else []
    everything = ["belief", "1.0000", "", *_probabilities(told.belief.class_probabilities[told.row])]
    return [header, *rows, *([*row, *[""] * (len(header) - 2)] for row in rest), everything]


def rivals_table(told: Explanation, own: HistoryExplained) -> list[list[str]]:
    """Header, and a row for each of the likeliest alternatives."""
    if not own.rivals:
        return []
    header = [
        "keyframe",
        "might have been of",
        "then",
        "now",
        "given up in",
        "behind before",
        "behind [nats]",
        "seen then",
    ]
    chosen = sorted(own.rivals, key=lambda rival: -rival.then)[:MOST_RIVALS]
    rows = [
        [
            str(rival.keyframe),
            _rival_name(told, rival),
            f"{rival.then:.4f}",
            f"{rival.now:.4f}",
            "-" if rival.gone is None else str(rival.gone),
            _plain(-rival.log_odds_before),
            _plain(-rival.log_odds),
            ", ".join(rival.by) if rival.gone is not None else "",
        ]
        for rival in sorted(chosen, key=lambda rival: (rival.keyframe, rival.detection, -rival.then))
    ]
    return [header, *rows]


def replay_line(told: Explanation) -> str:
    """Whether the numbers are those of the run."""
    if told.run.is_same:
        return f"Inferred again: as recorded, to {told.run.largest_difference:.0e} nats."
    return (
        f"Inferred again: differs from what was recorded by up to {told.run.largest_difference:.1e} nats; explain with"
        " the version that recorded the bag to have its own numbers."
    )


def _alone(told: Explanation, own: HistoryExplained) -> np.ndarray:
    """(V,) nats of each view by itself between the two classes, at the poses of the history."""
    assert told.classes is not None
    index = {keyframe.belief.keyframe: k for k, keyframe in enumerate(told.run.keyframes)}
    one, other = told.classes
    rows = [index[view.keyframe] for view in own.views]
    return np.asarray(own.ledger.alone[rows, one] - own.ledger.alone[rows, other])


def _directions(views: Sequence[Sighting]) -> str:
    """The range of directions, across the widest gap between them."""
    angles = np.sort(np.mod([view.direction_rad for view in views], 2.0 * np.pi))
    gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
    widest = int(np.argmax(gaps))
    first, last = angles[(widest + 1) % len(angles)], angles[widest]
    first, last = (float(np.rad2deg(value)) for value in (first, last))
    where = "its front" if views[0].from_front else "the x axis of map"
    return f"from {first:.0f} counter-clockwise to {last:.0f} deg of {where}"


def _degrees(view: Sighting) -> str:
    return f"{np.rad2deg(view.direction_rad) % 360.0:.0f}"


def _rival_name(told: Explanation, rival: Rival) -> str:
    """Name of what a detection might have been of; objects that only histories given up had have a number alone."""
    if rival.object_id < 0:
        return "no object"
    known = rival.object_id in told.belief.object_ids
    return object_name(told.belief, rival.object_id) if known else f"{rival.object_id} (given up)"


def _signed(value: float) -> str:
    return f"{value:+.3f}" if np.isfinite(value) else "-"


def _plain(value: float) -> str:
    return f"{abs(value) if value == 0.0 else value:.3f}" if np.isfinite(value) else "-"


def _probabilities(values: np.ndarray) -> list[str]:
    return [f"{value:.4f}" for value in values.tolist()]


def _filled(rows: list[list[str]]) -> list[list[str]]:
    """The columns with content; the first row is the header."""
    columns = [column for column in zip(*rows, strict=True) if set(column[1:]) - {"", "-"}]
    return [list(row) for row in zip(*columns, strict=True)]


def _aligned(rows: list[list[str]]) -> list[str]:
    """Columns to the right, the first one to the left."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    lines = [[row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))] for row in rows]
    return ["  ".join(line).rstrip() for line in lines]
