"""Digest of the class-model file of a run, which identifies it even if another file takes its name."""

import hashlib
from dataclasses import replace
from pathlib import Path

from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError


def noted(settings: SemanticModelConfiguration) -> SemanticModelConfiguration:
    """Settings with the digest of the named file filled in. Raises InputError where a different digest is required."""
    check_digest(settings)
    return replace(settings, path_digest=_digest(settings.path))


def check_digest(settings: SemanticModelConfiguration) -> None:
    """Raise InputError where the named file's digest is not the required one; a missing file is left to its reader."""
    found = _digest(settings.path)
    is_missing = bool(settings.path) and not found
    if settings.path_digest not in ("", found) and not is_missing:
        raise InputError(
            f"{settings.path or 'semantic_model.path'}: is not the file that the run was announced with (digest"
            f" '{found}', wanted '{settings.path_digest}'); put that file there, or leave out"
            " semantic_model.path_digest"
        )


def _digest(path: str) -> str:
    """Digest of a file's content; "" where no file is named or it does not exist."""
    if not path or not Path(path).is_file():
        return ""
    return hashlib.blake2b(Path(path).read_bytes(), digest_size=8).hexdigest()
