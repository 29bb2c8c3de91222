"""Files of embedding-model parameters learned from runs; nothing in them is executed."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.model_files import ModelFormat
from semantic_slam.viewpoint.embeddings.model import EmbeddingModel

ANEW = "fit it anew with semantic_slam fit --from-run"
FORMAT = ModelFormat(kind="embedding", schema_version=1, remedy=f"check semantic_model.path, or {ANEW}")


@dataclass(frozen=True, kw_only=True)
class LooksByDirection:
    """Learned parameters of how appearance varies with viewing direction, over R settings of (s, n)."""

    repeat_rad: float  # angle over which an object's appearance changes
    counts: tuple[float, ...]  # (R,) prior pseudo-count of objects per setting
    outlier_share: float | None = None  # None: as configured, in files of versions that did not learn it

    def of(self, model: EmbeddingModel) -> EmbeddingModel:
        """Copy of ``model`` with the learned parameters in place of the network-independent defaults."""
        share = model.outlier_share if self.outlier_share is None else self.outlier_share
        return replace(model, repeat_rad=self.repeat_rad, shared_counts=self.counts, outlier_share=share)


@dataclass(frozen=True, kw_only=True)
class FittedEmbeddings:
    """Parameters learned from B runs of one network, with leave-one-out variants."""

    dimensions: int
    spread_shares: tuple[float, ...]
    noise_shares: tuple[float, ...]
    whole: LooksByDirection | None  # None: too little data
    without: dict[str, LooksByDirection]  # by digest of a bag: learned from the other bags
    report: dict[str, Any]

    def model(self, model: EmbeddingModel, sha256: str) -> EmbeddingModel:
        """Model for a run of the bag with that digest. Raises ValueError where ``model`` has other settings."""
        own = (model.dimensions, model.spread_shares, model.noise_shares)
        if own != (self.dimensions, self.spread_shares, self.noise_shares):
            raise ValueError("it was fitted with other embedding_dimensions, spread_shares or noise_shares")
        looks = self.without.get(sha256, self.whole)
        return model if looks is None else looks.of(model)


def save_embeddings(fitted: FittedEmbeddings, path: Path) -> None:
    """Write the learned parameters; the file has no arrays."""
    FORMAT.write(path, {"none": np.zeros(1)}, asdict(fitted))


def read_embeddings(path: Path) -> FittedEmbeddings:
    """Read such a file. Raises InputError naming the file, the fault and the remedy."""
    _, entries = FORMAT.read(path)
    try:
        return parsed_embeddings(entries)
    except (KeyError, TypeError, ValueError) as fault:
        raise InputError(f"{path}: incomplete models of vectors ({fault}); {ANEW}") from None


def parsed_embeddings(entries: dict[str, Any]) -> FittedEmbeddings:
    """Learned parameters from their description in a file. Raises KeyError, TypeError or ValueError."""
    found = FittedEmbeddings(
        dimensions=int(entries["dimensions"]),
        spread_shares=tuple(map(float, entries["spread_shares"])),
        noise_shares=tuple(map(float, entries["noise_shares"])),
        whole=None if entries["whole"] is None else _looks(entries["whole"]),
        without={str(name): _looks(own) for name, own in dict(entries["without"]).items()},
        report=dict(entries["report"]),
    )
    _check(found)
    return found


def _looks(entry: Any) -> LooksByDirection:
    entries = dict(entry)
    share = entries.get("outlier_share")
    return LooksByDirection(
        repeat_rad=float(entries["repeat_rad"]),
        counts=tuple(map(float, entries["counts"])),
        outlier_share=None if share is None else float(share),
    )


def _check(found: FittedEmbeddings) -> None:
    """Raise ValueError for values that no run can yield."""
    size = len(found.spread_shares) * len(found.noise_shares)
    for own in (*([] if found.whole is None else [found.whole]), *found.without.values()):
        counts = np.array(own.counts)
        if counts.shape != (size,) or not np.isfinite(counts).all() or counts.min() <= 0.0:
            raise ValueError("counts must be one for each setting, finite and above 0")
        if not (np.isfinite(own.repeat_rad) and own.repeat_rad > 0.0):
            raise ValueError("repeat_rad must be above 0")
        if own.outlier_share is not None and not 0.0 <= own.outlier_share < 1.0:
            raise ValueError("outlier_share must not be below 0, and be below 1")
