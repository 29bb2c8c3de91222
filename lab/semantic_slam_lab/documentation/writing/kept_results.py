"""The results that pages are written from: docs/results/NAME.json, shortened copies of what studies and bench wrote."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from semantic_slam.errors import InputError

LEFT_OUT = frozenset({"steps", "final", "shown", "runs", "keyframes", "tracks_m"})
"""Keys of what figures are drawn from: every step of every run. No table shows them."""
MOST_ITEMS = 40
"""Longer lists are data of figures, too, but for those below."""
SHOWN = frozenset({"claims", "results", "forgeries"})
"""Lists of which every row is in a table."""
DIGITS = 6
"""Significant ones: more than any table shows."""


@dataclass(frozen=True)
class KeptResults:
    """Name of a study (or ``bench``, or of a report) -> its result."""

    results: dict[str, dict[str, Any]]

    def at(self, address: str) -> Any:
        """The value at ``study:key/key/...``; a number indexes a list. Raises InputError where there is none."""
        study, _, path = address.partition(":")
        found: Any = self.results.get(study)
        for key in path.split("/"):
            try:
                found = found[int(key)] if isinstance(found, list) else found[key]
            except (KeyError, IndexError, TypeError, ValueError):
                raise InputError(f"{address}: no such result; keep it with --keep, or correct the address") from None
        return found

    def has(self, study: str) -> bool:
        """Whether a result of this name is kept."""
        return study in self.results


def read_kept(folder: Path) -> KeptResults:
    """All results of a folder. Raises InputError for a file that is no JSON."""
    results = {}
    for path in sorted(folder.glob("*.json")):
        try:
            results[path.stem] = json.loads(path.read_text(encoding="utf-8"))
        except json.JSONDecodeError as fault:
            raise InputError(f"{path}: not readable as JSON ({fault}); keep the result again") from None
    return KeptResults(results)


def keep(source: Path, folder: Path, remark: str = "") -> Path:
    """Write the shortened copy of a result.json or bench.json; returns its path. Raises InputError.

    ``remark`` is what a reader of the numbers has to know, such as what else the machine did.
    """
    try:
        result = json.loads(source.read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError) as fault:
        raise InputError(f"{source}: no readable result ({fault}); name a result.json") from None
    path = folder / f"{result.get('study') or source.stem}.json"
    result |= {"remark": remark} if remark else {}
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(shortened(result), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def shortened(value: Any) -> Any:
    """``value`` without what only figures need and without folders of the machine, its numbers rounded."""
    if isinstance(value, dict):
        kept = {key: shortened(item) for key, item in value.items() if not _only_for_figures(key, item)}
        return {key: item for key, item in kept.items() if item != {} and item != []}
    if isinstance(value, list):
        return [shortened(item) for item in value]
    if isinstance(value, str) and Path(value).is_absolute() and Path(value).suffix:
        return Path(value).name
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _only_for_figures(key: str, value: Any) -> bool:
    if not isinstance(value, (dict, list)) or key in SHOWN:
        return False
    return key in LEFT_OUT or (isinstance(value, list) and len(value) > MOST_ITEMS)
