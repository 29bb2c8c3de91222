"""Photographs on turntables: what their paths or a table say of them, and where the object is in them."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from semantic_slam.datasets.turntables.pattern import PathPattern
from semantic_slam.datasets.turntables.photographs import by_pattern, by_table
from semantic_slam.errors import InputError
from semantic_slam.training.turntables import views_of

COIL = "{object}__{azimuth}.jpg"
ETH = "{object}/{object}-{polar}-{azimuth}.png"
ETH_MASKS = "{object}/maps/{object}-{polar}-{azimuth}-map.png"


def write_photograph(file: Path, background: int = 30) -> None:
    """A bright disc of radius 10 about (30, 20), with a hole of the background's colour in it."""
    picture = np.full((48, 64, 3), background, dtype=np.uint8)
    cv2.circle(picture, (30, 20), 10, (40, 90, 220), -1)
    cv2.circle(picture, (30, 20), 3, (background,) * 3, -1)
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), picture)


@pytest.mark.parametrize(
    ("pattern", "path", "said"),
    [
        (COIL, "obj5__355.jpg", ("obj5", 355.0, 0.0)),
        (ETH, "apple1/apple1-035-090.png", ("apple1", 90.0, 55.0)),
        ("{object}_{elevation}_{clockwise}.png", "red_mug_-7.5_90.png", ("red_mug", 270.0, -7.5)),
        ("(a+)+{object}.{azimuth}", "(a+)+x.1", ("x", 1.0, 0.0)),
    ],
)
def test_a_path_tells_object_and_direction(pattern: str, path: str, said: tuple[str, float, float]) -> None:
    named = PathPattern(pattern).read(path)
    assert named is not None
    assert (named.object_name, named.azimuth_deg, named.elevation_deg) == said


@pytest.mark.parametrize("path", ["obj5__x.jpg", "obj5__5.jpeg", "sub/obj5__5.jpg", "obj5__5.jpg.txt"])
def test_another_path_tells_nothing(path: str) -> None:
    assert PathPattern(COIL).read(path) is None


def test_a_field_that_stands_twice_has_to_say_the_same() -> None:
    assert PathPattern(ETH).read("apple1/apple2-035-090.png") is None


@pytest.mark.parametrize(
    ("pattern", "fault"),
    [
        ("{azimuth}.jpg", "needs {object}"),
        ("{object}.jpg", "needs {azimuth}"),
        ("{object.__class__}__{azimuth}.jpg", "no field {object.__class__}"),
    ],
)
def test_a_pattern_that_cannot_tell_is_bad_input(pattern: str, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        PathPattern(pattern)


def test_a_folder_with_missing_views_and_other_files_is_read(tmp_path: Path) -> None:
    for name in ("a__0.jpg", "a__5.jpg", "b__350.jpg", "contact_sheet.jpg"):
        write_photograph(tmp_path / name)
    found = by_pattern(tmp_path, COIL)
    assert [(own.object_name, own.azimuth_deg) for own in found.photographs] == [("a", 0.0), ("a", 5.0), ("b", 350.0)]
    assert found.other_files == 1
    view = views_of(found.photographs)[2]
    assert view.azimuth_rad == pytest.approx(np.deg2rad(-10.0))
    assert (view.class_name, view.angle_deg, view.cutout.shape) == ("b", 350, (21, 21, 3))
    assert view.mask[10, 10] == 255, "a hole is of the object"


def test_masks_have_a_pattern_of_their_own(tmp_path: Path) -> None:
    write_photograph(tmp_path / "apple1" / "apple1-090-000.png")
    mask = np.zeros((48, 64), dtype=np.uint8)
    mask[10:14, 20:32] = 255
    (tmp_path / "apple1" / "maps").mkdir()
    cv2.imwrite(str(tmp_path / "apple1" / "maps" / "apple1-090-000-map.png"), mask)
    (view,) = views_of(by_pattern(tmp_path, ETH, ETH_MASKS).photographs)
    assert view.cutout.shape == (4, 12, 3)
    with pytest.raises(InputError, match="is no field of"):
        by_pattern(tmp_path, ETH, "{elevation}.png")


def test_a_folder_without_such_photographs_is_bad_input(tmp_path: Path) -> None:
    write_photograph(tmp_path / "a-0.jpg")
    with pytest.raises(InputError, match="none of 1 files"):
        by_pattern(tmp_path, COIL)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_a_table_lists_photographs(tmp_path: Path, encoding: str) -> None:
    write_photograph(tmp_path / "pictures" / "1.png")
    table = tmp_path / "views.csv"
    table.write_text("file,object,azimuth_deg,elevation_deg,range_m\npictures/1.png,mug,-90,30,\n", encoding=encoding)
    (photograph,) = by_table(table).photographs
    assert (photograph.object_name, photograph.azimuth_deg, photograph.elevation_deg) == ("mug", 270.0, 30.0)
    assert photograph.range_m == 1.0
    assert views_of([photograph])[0].elevation_rad == pytest.approx(np.deg2rad(30.0))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("file,object\na.png,mug\n", "no column azimuth_deg"),
        ("file,object,azimuth_deg,colour\na.png,mug,0,red\n", "unknown column 'colour'"),
        ("file,object,azimuth_deg\na.png,mug,left\n", "line 2: azimuth_deg is 'left'"),
        ("file,object,azimuth_deg\na.png,mug,nan\n", "line 2: azimuth_deg is 'nan'"),
        ("file,object,azimuth_deg\na.png,,1\n", "line 2: file or object is empty"),
        ("file,object,azimuth_deg\n", "no photographs"),
    ],
)
def test_a_table_that_does_not_tell_is_bad_input(tmp_path: Path, text: str, fault: str) -> None:
    table = tmp_path / "views.csv"
    table.write_text(text)
    with pytest.raises(InputError, match=fault):
        by_table(table)


@pytest.mark.parametrize("content", [b"", b"no picture", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\xff\xff\xff\0\xff\xff\xff"])
def test_a_file_that_is_no_picture_is_bad_input(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a__0.jpg").write_bytes(content)
    with pytest.raises(InputError, match=r"a__0\.jpg"):
        views_of(by_pattern(tmp_path, COIL).photographs)


def test_pictures_of_nothing_are_bad_input(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a__0.jpg"), np.full((20, 20, 3), 30, dtype=np.uint8))
    with pytest.raises(InputError, match="no object in any"):
        views_of(by_pattern(tmp_path, COIL).photographs)
