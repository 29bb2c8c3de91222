"""What fuzzing has run and found, for the console and to be kept."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from semantic_slam_lab.fuzz.limits import CPU_S, MEBIBYTE, MEMORY_BYTES
from semantic_slam_lab.kills.comparison import kept
from semantic_slam_lab.studies.result import Claim, Table, required, write_result


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A case that ended otherwise than well, or with an error of ours."""

    target: str
    index: int
    what: str  # one line
    where: str  # file:line of the deepest frame of this package
    trace: str = ""


@dataclass
class Fuzzed:
    """Cases by target, and what was found."""

    cases: Counter[str] = field(default_factory=Counter)
    findings: dict[tuple[str, str, str], list[Finding]] = field(default_factory=dict)  # what is alike under one key

    @property
    def num_cases(self) -> int:
        """Number of cases of all targets."""
        return self.cases.total()

    def note_all(self, cases: Iterable[tuple[str, Finding | None]]) -> None:
        """Count cases by their targets, and keep what was found."""
        for target, finding in cases:
            self.note(target, finding)

    def note(self, target: str, finding: Finding | None) -> None:
        """Count a case of a target, and keep what was found."""
        self.cases[target] += 1
        if finding is not None:
            key = (finding.target, finding.what.split(":")[0], finding.where)
            self.findings.setdefault(key, []).append(finding)

    @property
    def lines(self) -> Iterator[str]:
        """A line for each kind of finding, which says how to run its first case again."""
        for same in self.findings.values():
            first = same[0]
            yield f"{first.target} --index {first.index} ({len(same)} times): {first.what} at {first.where}"

    @property
    def claim(self) -> Claim:
        """What fuzzing is to show."""
        limits = f"{CPU_S:.0f} s of CPU, {MEMORY_BYTES // MEBIBYTE} MiB more"
        text = f"No exception but the project's own, none of them longer than a line; no case over {limits}"
        measured = f"{self.num_cases} cases, {len(self.findings)} findings"
        return required(text, measured, bool(self.num_cases and not self.findings))

    @property
    def table(self) -> Table:
        """A row for each target."""
        rows = tuple((name, str(self.cases[name]), str(self._num_found(name))) for name in sorted(self.cases))
        return Table("Cases", ("target", "cases", "findings"), rows)

    def _num_found(self, target: str) -> int:
        return sum(key[0] == target for key in self.findings)


def write_fuzzed(out: Path, found: Fuzzed, seed: int, seconds: float) -> None:
    """Write result.json and its page."""
    targets = {row[0]: {"cases": int(row[1]), "findings": int(row[2])} for row in found.table.rows}
    result = {"seconds": seconds, "cases": found.num_cases, "targets": targets, "findings": list(found.lines)}
    _write(out, "fuzz", seed, result, found.claim, found.table)


@dataclass(frozen=True, kw_only=True)
class Forged:
    """What a demo was sent, and what came of it."""

    num_messages: int  # forgeries and questions
    counted: Mapping[tuple[str, str, str], int]  # node, topic, kind of forgery -> how many that node had to count
    refused: Mapping[str, int]  # service -> refusals
    largest_difference: float  # of any number of a belief, from a demo left in peace
    findings: Sequence[str]

    @property
    def lines(self) -> Iterator[str]:
        """For the console."""
        for (node, topic, kind), number in sorted(self.counted.items()):
            yield f"{node}: {number} x {topic}: {kind}"
        for service, number in sorted(self.refused.items()):
            yield f"{service}: refused {number} times"
        yield f"largest difference of beliefs {self.largest_difference:.3g}"
        yield from self.findings
        yield f"{self.num_messages} messages, {len(self.findings)} findings"

    @property
    def claim(self) -> Claim:
        """What forged messages are to show."""
        text = "No node dies of forged messages, each counts what it was sent, and the beliefs are the same"
        measured = f"{self.num_messages} messages, {len(self.findings)} findings"
        told = f"{measured}, largest difference of any number {self.largest_difference:.2g}"
        return required(text, told, bool(self.num_messages and not self.findings))

    @property
    def table(self) -> Table:
        """A row for each node and kind of forgery, over its topics, and for each service."""
        by_kind = Counter[tuple[str, str]]()
        for (node, _, kind), number in self.counted.items():
            by_kind[node, kind] += number
        rows = [(node, kind, str(number)) for (node, kind), number in sorted(by_kind.items())]
        rows += [(service, "refused", str(number)) for service, number in sorted(self.refused.items())]
        return Table("Forgeries", ("to", "kind", "number"), tuple(rows))


def write_forged(out: Path, found: Forged, seed: int) -> None:
    """Write result.json and its page."""
    result = {
        "messages": found.num_messages,
        "forgeries": [list(row) for row in found.table.rows],
        "largest_difference": kept(found.largest_difference),
        "findings": list(found.findings),
    }
    _write(out, "forged_messages", seed, result, found.claim, found.table)


def _write(out: Path, study: str, seed: int, result: dict[str, Any], claim: Claim, table: Table) -> None:
    from semantic_slam.pipeline.provenance import revision

    told = {"study": study, "quick": False, "seed": seed, "revision": revision(), **result}
    for path in write_result(out, told, [claim], [table]):
        print(path)
