"""The rows of one method on every drive of a kind, of which none is left out because the method failed there."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

Row = Mapping[str, Any]
Drives = Mapping[str, Mapping[str, Mapping[str, Row]]]


@dataclass(frozen=True)
class Rows:
    """Metrics of one method, drive by drive."""

    method: str
    drives: tuple[str, ...]  # on which it was asked for
    rows: tuple[Row, ...]  # metrics of each; those of a run that failed or ended early are not known
    failed: tuple[str, ...]  # drives on which there was a fault

    @classmethod
    def of(cls, drives: Drives, kind: str, method: str) -> "Rows":
        """Rows of ``method`` on the drives of ``kind``, as the result has them."""
        asked = {
            name: drive["methods"][method]
            for name, drive in drives.items()
            if name.startswith(kind) and method in drive["methods"]
        }
        failed = tuple(name for name, row in asked.items() if row.get("fault"))
        rows = tuple({} if name in failed else row for name, row in asked.items())
        return cls(method, tuple(asked), rows, failed)

    def __bool__(self) -> bool:
        return bool(self.drives)

    def values(self, key: str) -> list[float | None]:
        """A metric on every drive; None where it is not known."""
        return [row.get(key) for row in self.rows]

    def mean(self, key: str) -> float | None:
        """Mean of a metric over all drives; None if it is not known on one of them."""
        known = [value for value in self.values(key) if value is not None]
        return float(np.mean(known)) if len(known) == len(self.drives) > 0 else None


def failures(*methods: Rows) -> str:
    """Where the methods failed, to follow what was measured; "" where they did not."""
    return "".join(f"; {own.method} failed on {', '.join(own.failed)}" for own in methods if own.failed)
