"""Safe outputs: user files are replaced only with permission, and only once the new output is complete.

A command claims its output path before it starts to work. Replacing an existing output needs permission
(``--overwrite``), unless it lies below ``out/``, this project's own output folder; an input of the same command is
never accepted as output. Even with permission, a bag is replaced only where its ``metadata.yaml`` says that this
software wrote it.
"""

import argparse
import filecmp
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import mkdtemp

from semantic_slam.errors import InputError

LEAVE = "--overwrite"
LEAVE_OF_NODES = "overwrite:=true"
OUR_FOLDER = "out"
CHECKOUT = Path(__file__).parents[1]
OLD = ".old"
UNFINISHED = ".unfinished_"
BAG_SUFFIXES = frozenset({".mcap", ".db3", ".db3-shm", ".db3-wal"})
BAG_FILES = frozenset({"metadata.yaml", "objects.json"})
WRITER_KEY, WRITER = "written_by", "semantic_slam"
"""Entry in the ``custom_data`` of bags written here, which tells them from a user's recordings."""
REPORT_FILES = ("report.json", "report.html")


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add the ``--overwrite`` flag, which every command with an output has."""
    parser.add_argument(LEAVE, action="store_true", help="replace what is there; below out/ that needs no flag")


def check_output(out: Path, inputs: Iterable[Path | None] = (), overwrite: bool = False, leave: str = LEAVE) -> None:
    """Raise InputError where ``out`` is an input, or exists without permission; ``leave`` names the permission flag."""
    _check_inputs(out, inputs)
    if _has_content(out) and not overwrite and not is_ours(out):
        raise InputError(f"{out}: exists already; give {leave} to replace it, or name another output")


@contextmanager
def claimed(
    out: Path, inputs: Iterable[Path | None] = (), overwrite: bool = False, leave: str = LEAVE
) -> Iterator[Path]:
    """Context with the path to write ``out`` to, a file or folder replaced as a whole. Raises InputError.

    Where nothing exists yet, that is ``out`` itself. Otherwise it is a staging path beside it, which replaces the old
    output at the end of the context; after an exception the old one stays.
    """
    check_output(out, inputs, overwrite, leave)
    if not out.exists():
        with _anew(out):
            yield out
        return
    with _beside(out) as staged:
        yield staged
        _swap(staged, out.resolve())


@contextmanager
def claimed_file(
    out: Path, inputs: Iterable[Path | None] = (), overwrite: bool = False, leave: str = LEAVE
) -> Iterator[Path]:
    """:func:`claimed` for a file: a folder, a pipe or a device is refused even with permission."""
    if out.exists() and not out.is_file():
        raise InputError(f"{out}: is a {'folder' if out.is_dir() else 'pipe or a device'}; name a file")
    with claimed(out, inputs, overwrite, leave) as staged:
        yield staged


@contextmanager
def claimed_again(out: Path, place: Path) -> Iterator[Path]:
    """Resume an ``out`` that a killed process began: at ``out``, or in a :func:`staged_places`, swapped at the end."""
    yield place
    if place != out:
        _swap(place, out.resolve())
        shutil.rmtree(place.parent)


def staged_places(out: Path) -> list[Path]:
    """Staging paths of killed processes that began to replace ``out``, the newest first."""
    real = out.resolve()
    folders = sorted(real.parent.glob(f"{real.name}{UNFINISHED}*"), key=lambda folder: folder.stat().st_mtime)
    return [folder / real.name for folder in reversed(folders)]


@contextmanager
def claimed_bag(
    out: Path, inputs: Iterable[Path | None] = (), overwrite: bool = False, leave: str = LEAVE
) -> Iterator[Path]:
    """:func:`claimed` for a bag folder: anything but a bag written here is refused even with permission."""
    check_bag_output(out, inputs, overwrite, leave)
    with claimed(out, inputs, overwrite, leave) as staged:
        yield staged


def check_bag_output(out: Path, inputs: Iterable[Path | None], overwrite: bool, leave: str = LEAVE) -> None:
    """:func:`check_output` for a bag folder. Raises InputError."""
    _check_inputs(out, inputs)
    check_is_bag(out)
    check_output(out, (), overwrite, leave)
    if _has_content(out) and not is_ours(out):
        _check_written_here(out)


@contextmanager
def claimed_report(out: Path, inputs: Iterable[Path | None] = (), overwrite: bool = False) -> Iterator[Path]:
    """:func:`claimed_folder` for a report: a map or bag that belongs to no report is refused even with permission."""
    _check_inputs(out, given := list(inputs))
    if overwrite and out.is_dir() and not is_ours(out):
        _check_report_folder(out)
    with claimed_folder(out, given, overwrite) as staged:
        yield staged


def _check_report_folder(out: Path) -> None:
    """Raise InputError where a report would replace files that no report wrote: a bag's map, or a recording."""
    names = {item.name for item in out.iterdir()}
    bags = sorted(name for name in names if name == "metadata.yaml" or Path(name).suffix in BAG_SUFFIXES)
    if bags:
        raise InputError(f"{out}: holds a bag ({bags[0]}); name another folder for the report")
    if "objects.json" in names and not names.intersection(REPORT_FILES):
        raise InputError(f"{out}: holds an objects.json that is of no report; name another folder for the report")
    for belief in sorted(out.glob("belief*")):
        if belief.is_dir() and any(belief.iterdir()):
            _check_written_here(belief)


@contextmanager
def claimed_folder(
    out: Path, inputs: Iterable[Path | None] = (), overwrite: bool = False, names: Sequence[str] | None = None
) -> Iterator[Path]:
    """Context with the folder to write the files of ``out`` to; they replace files of equal names, others stay.

    ``names`` are the files that will be written: only these need permission where they exist. None: any existing file
    needs it.
    """
    _check_inputs(out, inputs)
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; name a folder")
    for item in [out] if names is None else [out / name for name in names]:
        check_output(item, (), overwrite)
    if not out.exists():
        with _anew(out):
            yield out
        return
    with _beside(out / out.resolve().name) as staged:  # staged inside ``out``: its parent folder may not be writable
        staged.mkdir()
        yield staged
        for item in sorted(staged.iterdir()):
            _put(item, out.resolve() / item.name)


@contextmanager
def claimed_folder_again(out: Path) -> Iterator[Path]:
    """Resume the files of folder ``out`` that a killed process began: in ``out``, or in a staging folder inside it."""
    place = next(iter(staged_places(out / out.resolve().name)), out)
    yield place
    if place != out:
        for item in sorted(place.iterdir()):
            _put(item, out.resolve() / item.name)
        shutil.rmtree(place.parent)


@contextmanager
def claimed_files(
    outs: Sequence[Path], inputs: Sequence[Path | None] = (), overwrite: bool = False
) -> Iterator[list[Path]]:
    """:func:`claimed` for several files of one command."""
    for out in outs:
        check_output(out, inputs, overwrite)
    with ExitStack() as stack:
        yield [stack.enter_context(claimed_file(out, inputs, overwrite)) for out in outs]


def write_whole(path: Path, text: str) -> None:
    """Write a text file atomically: complete or not at all. Raises OSError."""
    beside = path.with_name(f".{path.name}.unfinished")
    try:
        beside.write_text(text, encoding="utf-8")
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def is_ours(path: Path) -> bool:
    """Whether the resolved path lies below the ``out`` folder of the working directory or of this checkout."""
    ours = [base.resolve() / OUR_FOLDER for base in (Path.cwd(), CHECKOUT)]
    return any(folder in path.resolve().parents for folder in ours)


def check_is_bag(path: Path) -> None:
    """Raise InputError where ``path`` exists but is no bag folder, or holds more than a bag."""
    if not path.exists():
        return
    if not path.is_dir():
        raise InputError(f"{path}: exists and is no bag folder; name another output")
    names = sorted(item.name for item in path.iterdir())
    foreign = [name for name in names if name not in BAG_FILES and Path(name).suffix not in BAG_SUFFIXES]
    if foreign:
        raise InputError(f"{path}: holds {foreign[0]}, which is no part of a bag; name another output folder")


def _check_written_here(bag: Path) -> None:
    """Raise InputError where the bag's metadata do not say that this software wrote it."""
    import yaml  # slow import, deferred until the arguments are parsed

    try:
        metadata = yaml.safe_load((bag / "metadata.yaml").read_text(encoding="utf-8"))
        writer = metadata["rosbag2_bagfile_information"]["custom_data"][WRITER_KEY]
    except (OSError, ValueError, yaml.YAMLError, KeyError, TypeError):
        writer = None
    if writer != WRITER:
        raise InputError(
            f"{bag}: its metadata do not say that {WRITER} wrote it, so it is not replaced; move it away, or name"
            " another output"
        )


def _check_inputs(out: Path, inputs: Iterable[Path | None]) -> None:
    real = out.resolve()
    for given in filter(None, inputs):
        place = given.resolve()
        if real == place:
            raise InputError(f"{out}: is an input of this command; name another output")
        if real in place.parents:
            raise InputError(f"{out}: holds {given}, an input of this command; name another output")
        if place in real.parents:
            raise InputError(f"{out}: lies inside {given}, an input of this command; name another output")


def _has_content(path: Path) -> bool:
    """Whether replacing ``path`` would lose anything: it is a file, or a folder that is not empty."""
    return any(path.iterdir()) if path.is_dir() else path.exists()


@contextmanager
def _anew(out: Path) -> Iterator[None]:
    """Context that removes a new ``out`` after an InputError, so that the corrected command needs no permission."""
    try:
        yield
    except InputError:
        if out.is_dir():
            shutil.rmtree(out)
        elif out.exists():
            out.unlink()
        raise


@contextmanager
def _beside(out: Path) -> Iterator[Path]:
    """Context with a staging path of equal name in a temporary folder beside ``out``, on the same file system.

    The folder is removed at the end, but stays when the process is killed or abandons it.
    """
    real = out.resolve()
    try:
        folder = Path(mkdtemp(prefix=f"{real.name}{UNFINISHED}", dir=real.parent))
    except OSError as fault:
        raise InputError(f"{out}: cannot be written ({fault.strerror}); name another output") from None
    folder.chmod(0o755)
    try:
        yield folder / real.name
    except GeneratorExit:
        raise
    except BaseException:
        if not any(folder.glob(f"*{OLD}")):  # keep an old output that could not be moved back
            shutil.rmtree(folder)
        raise
    shutil.rmtree(folder)


def _put(new: Path, place: Path) -> None:
    """Move one entry of a folder to its final place, unless an identical file is there; symbolic links are skipped."""
    if new.is_symlink() or (new.is_file() and place.is_file() and filecmp.cmp(new, place, shallow=False)):
        return
    _swap(new, place)


def _swap(new: Path, place: Path) -> None:
    """Rename ``new`` to ``place``; a previous ``place`` moves into the folder of ``new``, which is removed later."""
    old = new.with_name(new.name + OLD)
    if not (place.is_dir() or new.is_dir()):
        os.replace(new, place)
        return
    try:
        if place.exists():
            place.rename(old)
        new.rename(place)
    except BaseException:
        if old.exists() and not place.exists():
            old.rename(place)
        raise
