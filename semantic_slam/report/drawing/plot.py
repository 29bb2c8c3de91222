"""A small plot as inline SVG: axes, lines, areas, columns over keyframes."""

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

Values = Sequence[float] | np.ndarray
ROUNDING = 1e-9
"""Share of the ends of a range by which a value may lie outside, as probabilities of 1 do after a sum."""


def nice_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """About ``count`` round numbers (1, 2 or 5 times a power of ten apart) inside [low, high]."""
    span = max(high - low, 1e-12)
    power = 10.0 ** math.floor(math.log10(span / count))
    step = next(factor * power for factor in (1, 2, 5, 10) if span / (factor * power) <= count)
    first = math.ceil(low / step - 1e-9)
    return [index * step for index in range(first, math.floor(high / step + 1e-9) + 1)]


class Plot:
    """One plot; parts are added in drawing order. Coordinates are data values unless said otherwise."""

    def __init__(
        self,
        x_range: tuple[float, float],
        y_range: tuple[float, float],
        *,
        width: int = 520,
        height: int = 210,
        logarithmic: bool = False,
        margins: tuple[int, int, int, int] = (10, 12, 34, 54),
        label: str = "",
    ) -> None:
        """``margins`` in pixels: top, right, bottom, left. ``label`` is read to those who do not see the picture."""
        self.width, self.height, self.label = width, height, label
        self.top, right, bottom, self.left = margins
        self.right, self.bottom = width - right, height - bottom
        self.x_range, self.y_range, self.logarithmic = x_range, y_range, logarithmic
        self._parts: list[Markup] = []

    def x(self, value: float) -> float:
        """Pixel of an x value."""
        low, high = self.x_range
        return self.left + (value - low) / max(high - low, 1e-12) * (self.right - self.left)

    def y(self, value: float) -> float:
        """Pixel of a y value; values beyond the range stop at its edge."""
        low, high = self.y_range
        if self.logarithmic:
            low, high, value = math.log10(low), math.log10(high), math.log10(max(value, low))
        share = min(max((value - low) / max(high - low, 1e-12), 0.0), 1.0)
        return self.bottom - share * (self.bottom - self.top)

    def axes(self, x_label: str = "keyframe", y_ticks: Sequence[float] | None = None, x_count: int = 6) -> None:
        """Grid lines with their values, and the name of the x axis."""
        ticks = y_ticks if y_ticks is not None else self._y_ticks()
        for value in ticks:
            self._add(
                '<line class="grid" x1="{}" x2="{}" y1="{}" y2="{}"/>',
                self.left,
                self.right,
                self.y(value),
                self.y(value),
            )
            self._add(
                '<text class="tick" text-anchor="end" x="{}" y="{}">{}</text>',
                self.left - 7,
                self.y(value) + 4,
                short(value),
            )
        for value in nice_ticks(*self.x_range, x_count):
            self._add(
                '<text class="tick" text-anchor="middle" x="{}" y="{}">{}</text>',
                self.x(value),
                self.bottom + 16,
                short(value),
            )
        if x_label:
            self._add(
                '<text class="tick" text-anchor="end" x="{}" y="{}">{}</text>', self.right, self.bottom + 30, x_label
            )

    def line(self, xs: Values, ys: Values, kind: str) -> None:
        """A line of CSS class ``kind``, broken where a value is not finite; values beyond the range are marked."""
        runs: list[list[str]] = [[]]
        for x, y in zip(xs, ys, strict=True):
            if math.isfinite(y):
                runs[-1].append(f"{self.x(x):.1f},{self.y(y):.1f}")
            elif runs[-1]:
                runs.append([])
        for run in runs:
            if len(run) == 1:
                x, _, y = run[0].partition(",")
                self._add('<circle class="dot {}" cx="{}" cy="{}" r="2"/>', kind, x, y)
            elif run:
                self._add('<polyline class="{}" points="{}"/>', kind, " ".join(run))
        for x, y in zip(xs, ys, strict=True):
            self._mark_beyond(x, y, kind)

    def _mark_beyond(self, x: float, y: float, kind: str) -> None:
        """A small triangle at the edge of the range that points to where a value lies beyond it."""
        low, high = self.y_range
        rounding = ROUNDING * (abs(low) + abs(high))
        if not math.isfinite(y) or low - rounding <= y <= high + rounding:
            return
        where, side = ("below", 1) if y < low else ("above", -1)
        shape = '<path class="dot {}" d="M{} {}h8l-4 {}z"><title>{} the scale</title></path>'
        self._add(shape, kind, self.x(x) - 4, self.y(y) - 6.0 * side, 6 * side, where)

    def area(self, xs: Values, low: Values, high: Values, fill: str) -> None:
        """The area between two lines."""
        there = [f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in zip(xs, high, strict=True)]
        back = [f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in zip(xs, low, strict=True)]
        self._add('<polygon fill="{}" points="{}"/>', fill, " ".join(there + back[::-1]))

    def column(self, x: float, low: float, high: float, fill: str) -> None:
        """A column one unit wide, centred on ``x``."""
        left, right = self.x(x - 0.5), self.x(x + 0.5)
        gap = 0.6 if right - left > 4 else -0.8  # narrow columns overlap, or pixels between them stay white
        top, bottom = self.y(high), self.y(low)
        height = max(bottom - top - (0.5 if bottom - top > 2 else 0.0), 0.2)
        edges = "" if gap > 0 else Markup(' shape-rendering="crispEdges"')
        template = '<rect fill="{}" x="{}" y="{}" width="{}" height="{}"{}/>'
        self._add(template, fill, f"{left:.2f}", top, f"{right - left - gap:.2f}", height, edges)

    def rule(self, value: float, kind: str, text: str = "") -> None:
        """A horizontal line at ``value`` with its name at the right end."""
        self._add(
            '<line class="{}" x1="{}" x2="{}" y1="{}" y2="{}"/>',
            kind,
            self.left,
            self.right,
            self.y(value),
            self.y(value),
        )
        self._add('<text class="note" text-anchor="end" x="{}" y="{}">{}</text>', self.right, self.y(value) - 4, text)

    def mark(self, value: float, text: str) -> None:
        """A vertical line at the x ``value`` with a note."""
        x = self.x(value)
        anchor = "start" if x < (self.left + self.right) / 2 else "end"
        self._add('<line class="mark" x1="{}" x2="{}" y1="{}" y2="{}"/>', x, x, self.top, self.bottom)
        shift = 5 if anchor == "start" else -5
        self._add('<text class="note" text-anchor="{}" x="{}" y="{}">{}</text>', anchor, x + shift, self.top + 12, text)

    def caption(self, text: str) -> None:
        """What the plot shows, above its upper left corner."""
        self._add('<text class="note" x="{}" y="{}">{}</text>', 2, self.top - 4, text)

    def svg(self) -> Markup:
        """The finished picture, with the line that follows the chosen keyframe."""
        cursor = Markup('<line class="cursor" y1="{}" y2="{}" visibility="hidden"/>').format(self.top, self.bottom)
        opening = Markup(
            '<svg class="plot" role="img" aria-label="{}" viewBox="0 0 {} {}"'
            ' data-left="{}" data-right="{}" data-low="{}" data-high="{}">'
        ).format(self.label, self.width, self.height, self.left, self.right, *self.x_range)
        return opening + Markup("").join(self._parts) + cursor + Markup("</svg>")

    def _y_ticks(self) -> list[float]:
        if not self.logarithmic:
            return nice_ticks(*self.y_range, 4)
        low, high = (math.floor(math.log10(value) + 1e-9) for value in self.y_range)
        step = max(1, (high - low) // 4)
        return [10.0**power for power in range(low, high + 1, step) if 10.0**power >= self.y_range[0] * 0.999]

    def _add(self, template: str, *values: object) -> None:
        rounded = [f"{value:.1f}" if isinstance(value, float) else value for value in values]
        self._parts.append(Markup(template).format(*rounded))


def short(value: float) -> str:
    """A tick's number without needless digits."""
    if value and (abs(value) < 1e-3 or abs(value) >= 1e5):
        return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")
    return f"{value:.10g}" if abs(value - round(value)) < 1e-9 else f"{value:.3g}"
