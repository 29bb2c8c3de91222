"""Whatever reads a picture by its name looks at what it claims before it is decoded."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from worlds.hostile_pictures import png_that_claims, png_with_a_chunk_of

from semantic_slam.datasets.avd.scene import AvdScene
from semantic_slam.datasets.bigbird import TurntableView
from semantic_slam.datasets.image_folders.image_folder import read_colour, read_depth
from semantic_slam.datasets.image_folders.intrinsics import picture_size
from semantic_slam.datasets.scene_messages import compressed_image
from semantic_slam.datasets.turntables.photographs import Photograph
from semantic_slam.errors import InputError
from semantic_slam.messages.images import MOST_PIXELS
from semantic_slam.messages.picture_files import read_picture
from semantic_slam.perception.frame import CameraModel
from semantic_slam.pipeline.lookalike_query import picture

ROOT = Path(__file__).parents[2]
CAMERA = CameraModel(32, 24, 30.0, 30.0, 16.0, 12.0, frame_id="camera")
NAME = "000110000010101.jpg"
Reader = Callable[[Path], object]
"""Reads the picture at a path through one of the importers."""


def of_avd(folder: Path) -> AvdScene:
    return AvdScene(folder, CAMERA, {}, {}, (), ())


def of_bigbird(folder: Path) -> TurntableView:
    return TurntableView(folder, "crate", "NP1", 0, np.eye(4), 1.0)


READERS: dict[str, tuple[str, Reader]] = {
    "a photograph on a turntable": ("a.jpg", lambda path: Photograph(path, "a", 0.0, 0.0).pixels()),
    "AVD's colour": (f"jpg_rgb/{NAME}", lambda path: of_avd(path.parents[1]).image(NAME)),
    "AVD's depth": (
        "high_res_depth/000110000010103.png",
        lambda path: of_avd(path.parents[1]).depth_m(NAME),
    ),
    "BigBIRD's colour": ("NP1_0.jpg", lambda path: of_bigbird(path.parent).image),
    "BigBIRD's mask": ("masks/NP1_0_mask.pbm", lambda path: of_bigbird(path.parents[1]).mask),
    "colour of a folder": ("frame-000000.color.jpg", read_colour),
    "depth of a folder, and TUM's": ("frame-000000.depth.png", lambda path: read_depth(path, CAMERA, 1000.0)),
    "the size of a folder's pictures": ("frame-000000.color.jpg", picture_size),
    "a scaled picture": ("a.png", lambda path: compressed_image(path, 0.5, 1, "camera", cv2.INTER_AREA)),
    "a crop to look for": ("crop.png", lambda path: picture(path.read_bytes(), str(path))),
}


@pytest.fixture
def undecoded(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenCV decodes nothing."""
    for name in ("imread", "imdecode"):
        monkeypatch.setattr(cv2, name, lambda *_: pytest.fail("decoded"))


@pytest.mark.parametrize(
    "data", [png_that_claims(60_000, 60_000), png_with_a_chunk_of(2**31 - 1)], ids=["size", "chunk"]
)
@pytest.mark.parametrize(("name", "read"), READERS.values(), ids=READERS)
def test_a_file_that_claims_gigabytes_is_one_line_and_never_decoded(
    name: str, read: Reader, data: bytes, tmp_path: Path, undecoded: None
) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"claims 60000 x 60000 pixels; give|not a picture; (restore|give)") as refused:
        read(path)
    assert str(refused.value).startswith(f"{path}: ") and "\n" not in str(refused.value)


def test_nothing_but_the_guarded_readers_decodes() -> None:
    guarded = {"messages/picture_files.py", "messages/images.py", "datasets/user_bag/image_formats.py"}
    decoding = {
        file.relative_to(package).as_posix()
        for package in (ROOT / "semantic_slam", ROOT / "lab" / "semantic_slam_lab")
        for file in package.rglob("*.py")
        if re.search(r"cv2\.im(read|decode)\w*\(", file.read_text(encoding="utf-8"))
    }
    assert decoding == guarded


def test_pixels_are_those_that_opencv_reads(tmp_path: Path) -> None:
    """Depth keeps its 16 bits, and a mask its one."""
    values = np.random.default_rng(0).integers(0, 65536, (24, 32), dtype=np.uint16)
    for name, stored in (("a.png", values), ("a.jpg", values.astype(np.uint8)), ("a.pbm", values.astype(np.uint8))):
        path = tmp_path / name
        cv2.imwrite(str(path), stored)
        for mode in (cv2.IMREAD_COLOR, cv2.IMREAD_GRAYSCALE, cv2.IMREAD_UNCHANGED):
            known = cv2.imread(str(path), mode)
            found = read_picture(path, mode)
            assert found.dtype == known.dtype
            np.testing.assert_array_equal(found, known)


@pytest.mark.parametrize(
    "content", [None, b"", b"no picture", b"P5 60 60 255\n"], ids=["missing", "empty", "text", "netpbm"]
)
def test_what_is_no_picture_is_named(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "a.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.png: missing or not a picture; restore it"):
        read_picture(path, cv2.IMREAD_COLOR)


def test_a_folder_by_the_name_of_a_picture_is_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="missing or not a picture"):
        read_picture(tmp_path, cv2.IMREAD_COLOR)


@pytest.mark.long
def test_what_tells_no_size_to_us_is_refused_by_opencv_before_it_makes_room(tmp_path: Path) -> None:
    """In a process that imports cv2 after this package, as the commands do."""
    paths = [tmp_path / f"a{ending}" for ending in (".webp", ".tiff", ".jp2", ".pgm")]
    for path in paths[:3]:
        path.write_bytes(cv2.imencode(path.suffix, np.zeros((10_001, 10_001), np.uint8))[1].tobytes())
    paths[3].write_bytes(b"P5 60000 60000 255\n")
    command = [sys.executable, "-c", READ_EACH, *map(str, paths)]
    said = subprocess.run(command, capture_output=True, text=True, check=True, env=own_environment()).stdout
    refusals = [f"{path}: claims more than {MOST_PIXELS} pixels; give a smaller picture" for path in paths]
    assert said.splitlines() == [*refusals, str(MOST_PIXELS)]


READ_EACH = """
import os
import sys
from pathlib import Path
from semantic_slam.errors import InputError
from semantic_slam.messages.picture_files import read_picture
for name in sys.argv[1:]:
    try:
        read_picture(Path(name), -1)
    except InputError as refusal:
        print(refusal)
print(os.environ["OPENCV_IO_MAX_IMAGE_PIXELS"])
"""


def own_environment() -> dict[str, str]:
    """Without a bound that this process has set already."""
    return {name: value for name, value in os.environ.items() if not name.startswith("OPENCV_IO_")}
