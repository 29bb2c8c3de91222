"""Check of intrinsics: consistency with the image size and with disparities, and internal plausibility."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.doctor.finding import Finding, error, warning
from semantic_slam.doctor.input_summary import DISPARITIES, InputSummary
from semantic_slam.messages.camera_info import USE_RECTIFIED
from semantic_slam.perception.frame import CameraModel

NAME = "intrinsics"
CENTRAL = (0.3, 0.7)
"""Share of the picture's width and height at which the optical axis lies, of any lens but of a cropped picture."""
NARROWEST_RAD, WIDEST_RAD = np.radians(8.0), np.radians(150.0)
"""Field of view of a pinhole camera on a robot."""
MOST_UNEQUAL = 1.3
"""Largest plausible ratio of fx and fy; square pixels have 1."""


def check(summary: InputSummary) -> Iterator[Finding]:
    camera = summary.camera
    if camera is None:
        return
    expected = (camera.width, camera.height)
    others = [size for size in summary.images.sizes if size != expected]
    for width, height in others[:1]:
        yield error(
            NAME,
            f"{summary.found.image} is {width} x {height} and camera_info says {camera.width} x {camera.height}",
            "give the camera_info of the pictures that are used, scaled as they are (width, height, fx, fy, cx, cy)",
        )
    if not others:
        yield from _of_itself(camera)
    if camera.distortion and DISPARITIES in summary.depths.encodings:  # none is left where rectified is set
        yield warning(
            NAME, "pictures count as distorted by the lens, and disparities are of rectified ones", USE_RECTIFIED
        )


def _of_itself(camera: CameraModel) -> Iterator[Finding]:
    centre = camera.cx / max(camera.width, 1), camera.cy / max(camera.height, 1)
    view_rad = 2.0 * np.arctan(0.5 * camera.width / camera.fx)
    told = f"fx {camera.fx:.4g}, fy {camera.fy:.4g}, cx {camera.cx:.4g}, cy {camera.cy:.4g}"
    what = f"intrinsics ({told}) do not fit a picture of {camera.width} x {camera.height}"
    remedy = "scale fx, fy, cx and cy with the picture, or calibrate the camera at this size"
    if not all(CENTRAL[0] <= share <= CENTRAL[1] for share in centre):
        text = f"{what}: the optical axis lies at {centre[0]:.0%} of its width and {centre[1]:.0%} of its height"
        make = error if min(centre) <= 0.0 or max(centre) >= 1.0 else warning
        yield make(NAME, text, f"{remedy}; of a cropped picture this may be right")
    elif not NARROWEST_RAD <= view_rad <= WIDEST_RAD:
        yield error(NAME, f"{what}: it would show {np.degrees(view_rad):.0f} deg from side to side", remedy)
    elif not 1.0 / MOST_UNEQUAL <= camera.fx / camera.fy <= MOST_UNEQUAL:
        yield warning(NAME, f"{what}: its pixels would be {camera.fx / camera.fy:.2f} times as high as wide", remedy)
