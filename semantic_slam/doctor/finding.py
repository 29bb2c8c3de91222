"""Findings of the doctor: one line each, with the fault, its numbers and the remedy."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum

from semantic_slam.errors import InputError, one_line


class Severity(IntEnum):
    """Severity of a finding."""

    WARNING = 1  # part of the input is lost, or less informative than possible
    ERROR = 2  # a run would not start, or its result would be wrong


@dataclass(frozen=True)
class Finding:
    """One fault with its remedy."""

    severity: Severity
    check: str  # name of the check
    what: str
    remedy: str

    @property
    def line(self) -> str:
        """Printed form on one line."""
        return " ".join(f"{self.severity.name.lower()}: {self.check}: {self.what}; {self.remedy}".split())

    def renamed(self, names: Mapping[str, str]) -> "Finding":
        """This finding with topics replaced by their remapped names."""
        if not names:
            return self
        known = "|".join(map(re.escape, names))
        whole = re.compile(rf"(?<![\w/])({known})(?![\w/])")
        what, remedy = (whole.sub(lambda found: names[found[0]], text) for text in (self.what, self.remedy))
        return replace(self, what=what, remedy=remedy)


def error(check: str, what: str, remedy: str) -> Finding:
    return Finding(Severity.ERROR, check, what, remedy)


def warning(check: str, what: str, remedy: str) -> Finding:
    return Finding(Severity.WARNING, check, what, remedy)


def of_fault(check: str, fault: InputError) -> Finding:
    """What an error of ours says: fault and remedy stand on either side of its last semicolon but for lists."""
    what, _, remedy = one_line(fault).partition("; ")
    return error(check, what, remedy or "correct it")
