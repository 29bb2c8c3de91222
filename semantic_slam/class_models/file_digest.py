"""Which file a run has its class models from: a name is not enough, another one may be put in its place."""

import hashlib
from dataclasses import replace
from pathlib import Path

from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError


def noted(settings: SemanticModelConfiguration) -> SemanticModelConfiguration:
    """With the digest of the named file. Raises InputError where another file is wanted."""
    check_digest(settings)
    return replace(settings, path_digest=_digest(settings.path))


def check_digest(settings: SemanticModelConfiguration) -> None:
    """Raises InputError where the named file is not the one that is wanted; readers name a missing one."""
    found = _digest(settings.path)
    is_missing = bool(settings.path) and not found
    if settings.path_digest not in ("", found) and not is_missing:
        raise InputError(
            f"{settings.path or 'semantic_model.path'}: is not the file that the run was announced with (digest"
            f" '{found}', wanted '{settings.path_digest}'); put that file there, or leave out"
            " semantic_model.path_digest"
        )


def _digest(path: str) -> str:
    """The digest of a file's content; empty where none is named, or none is there."""
    if not path or not Path(path).is_file():
        return ""
    return hashlib.blake2b(Path(path).read_bytes(), digest_size=8).hexdigest()
