"""The section of the page that sets several runs of one bag side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.report.comparison import FIRST_VIEWS, Course, Run, courses, final_probabilities
from semantic_slam.report.drawing.charts import Chart, Key, keyframes, time_plot
from semantic_slam.report.drawing.palette import OTHER_COLOUR
from semantic_slam.report.shown.objects import object_label
from semantic_slam.report.wording import known, listed, number, percent

RUN_KINDS = ("first", "third", "fourth", "fifth", "sixth")
"""CSS classes of the runs' lines, the main run's first."""
SHOWN_OBJECTS = 8
TOLD_OBJECTS = 3
EVEN = 1e-9


@dataclass(frozen=True)
class RunRow:
    """A run as a whole."""

    kind: str  # CSS class of its line
    name: str
    ate_m: float
    association_entropy: float
    discarded_mass_window: float
    discarded_mass: float
    differences: str  # from the main run's configuration


@dataclass(frozen=True)
class ObjectRow:
    """One object in one run."""

    label: str
    kind: str
    run: str
    probabilities: list[float]
    classes: list[tuple[str, str]]  # names and colours of the probabilities
    top: str
    odds: str  # which class over which
    start: str
    end: str
    change: str


@dataclass(frozen=True)
class ComparisonView:
    """The section of a report that compares runs."""

    sentences: list[str]
    charts: list[Chart]
    runs: list[RunRow]
    objects: list[ObjectRow]


def comparison_view(runs: Sequence[Run], classes: Sequence[tuple[str, str]]) -> ComparisonView | None:
    """The section for the main run and those it is compared with; None when it stands alone.

    ``classes`` are the page's class names with their colours.
    """
    if len(runs) < 2:
        return None
    by_run = [courses(runs[0].analysis, run)[:SHOWN_OBJECTS] for run in runs]
    by_object = list(zip(*by_run, strict=True))
    colours = dict(classes)
    return ComparisonView(
        sentences=[sentence for cells in by_object[:TOLD_OBJECTS] if (sentence := _sentence(runs, cells))],
        charts=[*(_odds_chart(runs, cells) for cells in by_object), _entropy_chart(runs)],
        runs=[_run_row(runs[0], run, kind) for run, kind in zip(runs, RUN_KINDS, strict=False)],
        objects=[
            _object_row(runs[0], run, course, kind, colours)
            for cells in by_object
            for run, course, kind in zip(runs, cells, RUN_KINDS, strict=False)
        ],
    )


def _sentence(runs: Sequence[Run], cells: Sequence[Course]) -> str:
    """What the views after the first ones changed, run by run."""
    parts = [_told(run, course) for run, course in zip(runs, cells, strict=True) if not np.isnan(course.change)]
    if not parts:
        return ""
    first, second = cells[0].pair
    return (
        f"Object {_label(runs[0], cells[0].object_id)}: from view {FIRST_VIEWS} to the last one the log-odds of {first}"
        f" over {second} change by {listed(parts)}."
    )


def _told(run: Run, course: Course) -> str:
    if course.pruned_at is not None:
        return f"beyond measure with {run.name} (pruned at keyframe {run.beliefs[course.pruned_at].keyframe})"
    return f"{number(abs(course.change), 1 if abs(course.change) >= 10 else 2)} nats with {run.name}"


def _odds_chart(runs: Sequence[Run], cells: Sequence[Course]) -> Chart:
    finite = np.concatenate([course.values[np.isfinite(course.values)] for course in cells])
    low, high = min(0.0, *finite) if len(finite) else 0.0, max(0.0, *finite) if len(finite) else 0.0
    margin = 0.08 * (high - low) + 0.1
    label = _label(runs[0], cells[0].object_id)
    first, second = cells[0].pair
    plot = time_plot(runs[0].beliefs, low - margin, high + margin, f"log-odds of object {label}, for every run")
    plot.axes()
    plot.rule(0.0, "mark", "even")
    start = cells[0].start
    if start is not None:
        plot.mark(float(runs[0].beliefs[start].keyframe), f"view {FIRST_VIEWS}")
    for run, course, kind in reversed(list(zip(runs, cells, RUN_KINDS, strict=False))):
        plot.line(keyframes(run.beliefs), course.values, f"line {kind}")
    keys = [_key(runs[0], run, kind, course.values) for run, course, kind in zip(runs, cells, RUN_KINDS, strict=False)]
    text = (
        f"Log-odds of {first} over {second} in nats: 0 is even, ± 4.6 is 99 to 1."
        " A line ends where one of the two classes is pruned."
    )
    return Chart(f"Object {label}: {first} or {second}", text, keys, plot.svg())


def _entropy_chart(runs: Sequence[Run]) -> Chart:
    values = [np.array([belief.association_entropy for belief in run.beliefs]) for run in runs]
    high = float(np.nanmax(np.concatenate([*values, [0.5]]))) * 1.08
    plot = time_plot(runs[0].beliefs, 0.0, high, "association entropy, for every run")
    plot.axes()
    for run, series, kind in reversed(list(zip(runs, values, RUN_KINDS, strict=False))):
        plot.line(keyframes(run.beliefs), series, f"line {kind}")
    keys = [_key(runs[0], run, kind, series) for run, series, kind in zip(runs, values, RUN_KINDS, strict=False)]
    return Chart("Association entropy", "In nats; 0 means one explanation of the detections.", keys, plot.svg())


def _key(main: Run, run: Run, kind: str, values: Any) -> Key:
    """A legend's entry; the values are those at the main run's keyframes, which the page's cursor follows."""
    at = {belief.keyframe: float(value) for belief, value in zip(run.beliefs, values, strict=True)}
    shown = [at.get(belief.keyframe, float("nan")) for belief in main.beliefs]
    return Key(kind, run.name, [value if np.isfinite(value) else float("nan") for value in shown])


def _run_row(main: Run, run: Run, kind: str) -> RunRow:
    last = run.beliefs[-1]
    differing = _differences(main.analysis.configuration, run.analysis.configuration)
    return RunRow(
        kind=kind,
        name=run.name,
        ate_m=run.ate_m,
        association_entropy=last.association_entropy,
        discarded_mass_window=last.discarded_mass_window,
        discarded_mass=last.discarded_mass,
        differences=", ".join(differing),
    )


def _differences(main: dict[str, Any], other: dict[str, Any], prefix: str = "") -> list[str]:
    """``dotted.name value`` of what ``other`` sets differently."""
    found: list[str] = []
    for name, value in other.items():
        if isinstance(value, dict):
            known_part = main.get(name)
            found += _differences(known_part if isinstance(known_part, dict) else {}, value, f"{prefix}{name}.")
        elif value != main.get(name):
            found.append(f"{prefix}{name} {value}")
    return found


def _object_row(main: Run, run: Run, course: Course, kind: str, colours: dict[str, str]) -> ObjectRow:
    probabilities = final_probabilities(run, course.object_id)
    best = max(probabilities, key=probabilities.__getitem__, default="")
    start = course.values[course.start] if course.start is not None else float("nan")
    return ObjectRow(
        label=_label(main, course.object_id),
        kind=kind,
        run=run.name,
        probabilities=list(probabilities.values()),
        classes=[(name, colours.get(name, OTHER_COLOUR)) for name in probabilities],
        top=f"{best} {percent(probabilities[best])}" if best else "–",
        odds=" : ".join(course.pair),
        start=_nats(start),
        end=_end(run, course),
        change=_nats(course.change),
    )


def _end(run: Run, course: Course) -> str:
    if course.pruned_at is not None:
        return f"pruned at keyframe {run.beliefs[course.pruned_at].keyframe}"
    return _nats(float(course.values[-1]))


def _nats(value: float) -> str:
    if not known(value) or not np.isfinite(value):
        return "–"
    return ("+" if value > EVEN else "") + number(value)


def _label(run: Run, object_id: int) -> str:
    last = run.beliefs[-1]
    return object_label(last, list(last.object_ids).index(object_id))
