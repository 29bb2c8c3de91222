"""Writing of mcap storage with checksums, which the writer of rosbags leaves out."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter, BytesIO
from pathlib import Path
from typing import Any
from zlib import crc32

from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter

from semantic_slam.bag.checksums import CHUNK_CRC, CRC_SIZE, DATA_END_SIZE, FOOTER
from semantic_slam.bag.chunk_limits import MAGIC_SIZE

WRITTEN_AT_ONCE = 4 << 20
"""Size of the write buffer in bytes: a chunk with its index is written at once, so a kill leaves no partial chunk."""


class ChecksumWriter(McapWriter):  # type: ignore[misc]  # rosbags is not followed by mypy
    """Writer of one mcap whose chunks, data section and summary have checksums."""

    bio: Any  # the file, or the section that is being made for it

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        """Create the file in the folder ``path``. Raises OSError."""
        super().__init__(path, compression)
        self.bio = BufferedWriter(self.bio.detach(), WRITTEN_AT_ONCE)
        self._crc = crc32(self.path.read_bytes())  # of everything in the file

    def close_chunk(self) -> None:
        """Write the pending chunk with its checksum, and its index."""
        crc = crc32(self.chunk.bio.getvalue())
        with self._section() as section:
            super().close_chunk()
            section.put(CHUNK_CRC, crc)

    def flush(self) -> None:
        """Write what is pending, through to the operating system."""
        if self.chunk.bio.tell():
            self.close_chunk()
        self.bio.flush()

    def close(self, version: int, metadata: str) -> None:
        """Write the summary and the checksums of data and summary, and close the file."""
        if self.chunk.bio.tell():
            self.close_chunk()
        with self._section() as section:
            super().close(version, metadata)
            self._put_checksums(section)
        self.bio.close()

    def _put_checksums(self, section: "_Section") -> None:
        """Put the checksums into the end of the file, from its metadata record on."""
        data = section.getvalue()
        footer_end = len(data) - MAGIC_SIZE
        _, _, summary_start, _, _ = FOOTER.unpack_from(data, footer_end - FOOTER.size)
        summary = summary_start - section.start
        data_crc = crc32(data[: summary - DATA_END_SIZE], self._crc)
        section.put(summary - CRC_SIZE, data_crc)
        section.put(footer_end - CRC_SIZE, crc32(data[summary : footer_end - CRC_SIZE]))

    @contextmanager
    def _section(self) -> Iterator["_Section"]:
        """Context in which what is written can be corrected; it is put into the file at the end."""
        file = self.bio
        self.bio = section = _Section(file.tell())
        try:
            yield section
        finally:
            self.bio = file
        self._crc = crc32(section.getvalue(), self._crc)
        file.write(section.getvalue())


class ChecksumBagWriter(Writer):  # type: ignore[misc]  # rosbags is not followed by mypy
    """rosbags' writer of bag folders, with :class:`ChecksumWriter` as its storage."""

    STORAGE_PLUGINS = {StoragePlugin.MCAP: ChecksumWriter}  # noqa: RUF012


class _Section(BytesIO):
    """Records of a file from the byte ``start`` on."""

    def __init__(self, start: int) -> None:
        super().__init__()
        self.start = start

    def tell(self) -> int:
        return self.start + super().tell()

    def close(self) -> None:
        """Stay open: it is put into the file first."""

    def put(self, place: int, crc: int) -> None:
        """Put a checksum at ``place`` in this section."""
        self.getbuffer()[place : place + CRC_SIZE] = crc.to_bytes(CRC_SIZE, "little")
