"""What the doctor has to say: one finding a line, what is wrong with its numbers, and what to do about it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum

from semantic_slam.errors import InputError


class Severity(IntEnum):
    """How bad it is."""

    WARNING = 1  # a part of the input is lost, or says less than it could
    ERROR = 2  # a run would not start, or its result would not be right


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong."""

    severity: Severity
    check: str  # which check has found it
    what: str
    remedy: str

    @property
    def line(self) -> str:
        """As it is printed."""
        return " ".join(f"{self.severity.name.lower()}: {self.check}: {self.what}; {self.remedy}".split())

    def renamed(self, names: Mapping[str, str]) -> "Finding":
        """This finding with topics called what they are remapped to."""
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
    what, _, remedy = " ".join(str(fault).split()).partition("; ")
    return error(check, what, remedy or "correct it")
