"""Files of fitted label models: arrays and a JSON description in one safetensors file; no code is executed."""

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.model_files import ModelFormat
from semantic_slam.viewpoint.detection_values import UNTOLD, DetectionValues
from semantic_slam.viewpoint.embeddings.store import FittedEmbeddings, parsed_embeddings
from semantic_slam.viewpoint.labels.confusion import HIDDEN_NONE, Confusion
from semantic_slam.viewpoint.labels.model import LabelModel
from semantic_slam.viewpoint.labels.runner_up import EVEN_HABITS
from semantic_slam.viewpoint.labels.settings import LabelSettings

ANEW = "fit it anew with semantic_slam fit --from-run"
FORMAT = ModelFormat(kind="detector", schema_version=1, remedy=f"check semantic_model.path, or {ANEW}")
OLDER_NAMES = {"settings.by_score": "settings.score_powers"}
"""Arrays that were named otherwise in files of older versions, where they had fewer values."""


@dataclass(frozen=True, kw_only=True)
class FittedBag:
    """One of the bags used for the fit, with the parameters fitted to the other bags (leave-one-out)."""

    path: str
    sha256: str
    stretch_edges_ns: tuple[int, ...]  # (F + 1,) starts of its stretches, and the end of the last
    log_settings: tuple[float, ...]  # (R,) log weights of the settings
    class_shares: tuple[float, ...]  # (C,)
    habits: tuple[float, ...] = tuple(EVEN_HABITS.tolist())  # (H,)
    detection: DetectionValues = UNTOLD


@dataclass(frozen=True, kw_only=True)
class FittedLabels:
    """Label model of a detector, fitted to runs of it; L labels, W words, S sectors, R settings."""

    labels: tuple[str, ...]
    settings: LabelSettings  # R
    confusions: tuple[Confusion, ...]  # one per stretch (F of all bags), fitted without it; the last fitted to all
    class_shares: Array  # (C,) with none of these
    bags: tuple[FittedBag, ...]
    report: dict[str, Any]
    habits: Array = field(default_factory=lambda: EVEN_HABITS)  # (H,) share of objects with each second-word habit
    detection: DetectionValues = UNTOLD
    vectors: FittedEmbeddings | None = None  # of the vectors that the same detections carry

    def detection_of(self, sha256: str) -> DetectionValues:
        """Detection values for a bag: fitted to the other bags where this one was part of the fit."""
        known = self.bag(sha256)
        return self.detection if known is None else known.detection

    def model(self, sha256: str = "") -> LabelModel:
        """Label model for a bag; if the bag was part of the fit, each stretch uses confusions fitted without it."""
        known = self.bag(sha256)
        if known is None:
            return LabelModel(
                labels=self.labels,
                settings=self.settings,
                confusions=self.confusions[-1:],
                class_shares=self.class_shares,
                habits=self.habits,
            )
        return LabelModel(
            labels=self.labels,
            settings=self.settings.weighted(np.array(known.log_settings)),
            confusions=self.confusions,
            class_shares=np.array(known.class_shares),
            habits=np.array(known.habits),
            stretch_edges_ns=known.stretch_edges_ns,
        )

    def bag(self, sha256: str) -> FittedBag | None:
        """Entry of the bag with that digest, if it was part of the fit; else None."""
        return next((own for own in self.bags if own.sha256 and own.sha256 == sha256), None)


def save_labels(fitted: FittedLabels, path: Path) -> None:
    """Write the models."""
    arrays = {f"settings.{item.name}": getattr(fitted.settings, item.name) for item in fields(LabelSettings)}
    for item in fields(Confusion):
        arrays[f"confusions.{item.name}"] = np.array([getattr(own, item.name) for own in fitted.confusions])
    arrays["class_shares"], arrays["habits"] = fitted.class_shares, fitted.habits
    description = {
        "labels": list(fitted.labels),
        "bags": [asdict(bag) for bag in fitted.bags],
        "report": fitted.report,
        "detection": asdict(fitted.detection),
        "vectors": None if fitted.vectors is None else asdict(fitted.vectors),
    }
    plain = {name: np.array(value, dtype=np.float64, order="C") for name, value in arrays.items()}
    FORMAT.write(path, plain, description)


def read_labels(path: Path) -> FittedLabels:
    """Read the models of a file. Raises InputError naming the file, the fault and the remedy."""
    arrays, description = FORMAT.read(path)
    try:
        found = _fitted(arrays, description)
        _check(found)
    except (KeyError, TypeError, ValueError) as fault:
        raise InputError(f"{path}: incomplete label models ({fault}); {ANEW}") from None
    return found


def _fitted(arrays: dict[str, Array], description: dict[str, Any]) -> FittedLabels:
    """Parse the content of a file. Raises KeyError, TypeError or ValueError."""
    current_arrays = {OLDER_NAMES.get(name, name): array for name, array in arrays.items()}
    parts = [arrays[f"confusions.{item.name}"] for item in fields(Confusion)]
    return FittedLabels(
        labels=tuple(map(str, description["labels"])),
        settings=LabelSettings(
            **{item.name: current_arrays[f"settings.{item.name}"] for item in fields(LabelSettings)}
        ),
        confusions=tuple(
            Confusion(counts=counts, none=none, outlier_share=float(share))
            for counts, none, share in zip(*parts, strict=True)
        ),
        class_shares=arrays["class_shares"],
        habits=arrays.get("habits", EVEN_HABITS),
        bags=tuple(_bag(own) for own in description["bags"]),
        report=dict(description["report"]),
        detection=_detection(description),
        vectors=None if description.get("vectors") is None else parsed_embeddings(description["vectors"]),
    )


def _bag(entries: dict[str, Any]) -> FittedBag:
    numbers = {name: tuple(entries[name]) for name in ("stretch_edges_ns", "log_settings", "class_shares")}
    habits = tuple(entries.get("habits", EVEN_HABITS.tolist()))
    return FittedBag(
        path=str(entries["path"]),
        sha256=str(entries["sha256"]),
        habits=habits,
        detection=_detection(entries),
        **numbers,
    )


def _detection(entries: dict[str, Any]) -> DetectionValues:
    """Parse detection values. Raises TypeError or ValueError."""
    own = dict(entries.get("detection") or {})
    shares = tuple(float(value) for value in own.pop("by_direction", ()))
    values = {name: None if value is None else float(value) for name, value in own.items()}
    return DetectionValues(by_direction=shares, **values)


def _check(found: FittedLabels) -> None:
    """Raise ValueError where shapes or values of the arrays do not fit together."""
    size, count = len(found.labels), len(found.settings)
    values = [getattr(found.settings, item.name) for item in fields(LabelSettings)]
    shapes: list[tuple[Array | Index, tuple[int, ...]]] = [(own, (count,)) for own in values]
    for confusion in found.confusions:
        sectors = found.confusions[-1].num_sectors
        shapes += [(confusion.counts, (sectors, size, size + 1)), (confusion.none, (HIDDEN_NONE, size + 1))]
    shapes += [(found.class_shares, (size + 1,)), (found.habits, EVEN_HABITS.shape)]
    for bag in found.bags:
        shapes.append((np.array(bag.stretch_edges_ns, dtype=np.int64), (len(found.confusions),)))
        shapes += [(np.array(bag.log_settings), (count,)), (np.array(bag.class_shares), (size + 1,))]
        shapes.append((np.array(bag.habits), EVEN_HABITS.shape))
    for values_, shape in shapes:
        if values_.shape != shape or not np.all(np.isfinite(values_)):
            raise ValueError("an array has a wrong shape or is not finite")
    if found.settings.score_powers.min() < 0.0:
        raise ValueError("powers of scores must not be below 0")
    for own in (found.detection, *(bag.detection for bag in found.bags)):
        _check_detection(own)
    counts = [part for own in found.confusions for part in (own.counts, own.none)]
    if min(part.min() for part in counts) <= 0.0 or min(found.class_shares.min(), found.habits.min()) <= 0.0:
        raise ValueError("counts and shares must be above 0")


def _check_detection(own: DetectionValues) -> None:
    """Raise ValueError for values that no detector can have."""
    probability, half_range, persistence = own.probability, own.half_range_m, own.persistence
    if probability is not None and not 0.0 < probability < 1.0:
        raise ValueError("a detection probability must lie between 0 and 1")
    if half_range is not None and not half_range > 0.0:
        raise ValueError("a half range must be above 0")
    if persistence is not None and not 0.0 <= persistence < 1.0:
        raise ValueError("a persistence must not be below 0, and be below 1")
    if len(own.by_direction) == 1 or not all(0.0 < share <= 1.0 for share in own.by_direction):
        raise ValueError("shares by direction must be two or more, above 0 and at most 1")
    if own.by_direction and not (own.field_of_view_rad and own.field_of_view_rad > 0.0):
        raise ValueError("shares by direction need the field of view that they are over")
