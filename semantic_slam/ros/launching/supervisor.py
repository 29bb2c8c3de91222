"""Decides on restarts when a node of a run ends: ``demo`` and the launch file both ask a :class:`Supervisor`.

A node that dies by a signal or an error is restarted together with its followers. A node that exits because of bad
input ends the run, since a restart does not correct the input, and so does one that dies too often.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from semantic_slam.cli.exit_codes import BAD_INPUT
from semantic_slam.ros.launching.node_set import NodeSpec

MOST_RESTARTS, WINDOW_S = 8, 120.0
"""Restarts of a node allowed within the window [s]; one more death ends the run."""
FIRST_DELAY_S, LONGEST_DELAY_S = 0.25, 4.0
"""Delay [s] before a restart; each further death within the window doubles it, up to the longest."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Action to take after a node has ended; by default none."""

    text: str = ""  # for the console
    again: NodeSpec | None = None  # to be started
    after_s: float = 0.0
    kill: tuple[str, ...] = ()  # nodes to be killed, whose end must be reported to the supervisor, too
    ends_run: bool = False


class Supervisor:
    """Tracks the nodes of one run; times are seconds of a steady clock."""

    def __init__(self, specs: Iterable[NodeSpec], last: str = "") -> None:
        """``last``: name of the node whose normal exit ends the run; "": none."""
        self._specs = {spec.name: spec for spec in specs}
        self._last = last
        self._deaths: dict[str, list[float]] = {}
        self._killed: set[str] = set()  # followers that the caller was told to kill
        self._done: set[str] = set()

    def ended(self, name: str, exit_code: int, now_s: float) -> Verdict:
        """Verdict on a node that has ended, with its exit code or -signal."""
        if name in self._killed:
            self._killed.discard(name)
            return Verdict(again=self._specs[name].anew())
        if exit_code == 0:
            self._done.add(name)
            return Verdict(text=f"{name} has ended", ends_run=name == self._last)
        return self._died(self._specs[name], exit_code, now_s)

    def is_down(self, name: str) -> None:
        """Note that a node to be killed had already ended, so that its next end is not taken for that kill."""
        self._killed.discard(name)

    def _died(self, spec: NodeSpec, exit_code: int, now_s: float) -> Verdict:
        lately = [at_s for at_s in self._deaths.get(spec.name, []) if now_s - at_s < WINDOW_S]
        self._deaths[spec.name] = [*lately, now_s]
        how = f"{spec.name} ended with exit code {exit_code}"
        if spec.again is None or exit_code == BAD_INPUT:
            return Verdict(text=how, ends_run=True)
        if len(lately) >= MOST_RESTARTS:
            return Verdict(text=f"{how}, for the {len(lately) + 1}th time in {WINDOW_S:.0f} s", ends_run=True)
        followers = tuple(name for name in spec.followers if name in self._specs and name not in self._done)
        self._killed.update(followers)
        return Verdict(
            text=f"{how}; it is started again",
            again=spec.anew(),
            after_s=min(FIRST_DELAY_S * 2 ** len(lately), LONGEST_DELAY_S),
            kill=followers,
        )
