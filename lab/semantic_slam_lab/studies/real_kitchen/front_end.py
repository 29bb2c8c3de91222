"""What the pictures of the kitchen tell: how the camera moved, by visual odometry, and NanoDet's boxes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from semantic_slam.datasets.image_folders.detector_arguments import given_detector
from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.images_import import found_in
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import Detections
from semantic_slam_lab.studies.real_kitchen.visual_odometry import visual_odometry


@dataclass(frozen=True)
class FrontEnd:
    """F pictures."""

    times_s: Array  # (F,)
    poses: Array  # (F, 4, 4) of the optical frame in that of the first picture
    failures: int  # pictures for which odometry failed
    found: list[Detections]  # (F,)

    def write_odometry(self, file: Path) -> None:
        """Rows t x y z qx qy qz qw, as ``import_dataset images`` reads them."""
        turns = Rotation.from_matrix(self.poses[:, :3, :3]).as_quat()
        np.savetxt(file, np.column_stack([self.times_s, self.poses[:, :3, 3], turns]), fmt="%.9f")


def front_end(folder: ImageFolder, weights: Path, seed: int) -> FrontEnd:
    """Odometry and boxes of a folder's pictures, with the network in ``weights``. Raises InputError."""
    poses, failures = visual_odometry(folder, seed)
    detector = given_detector(weights / "nanodet_m.onnx", weights / "coco.names")
    times_s = np.array([frame.time_s for frame in folder.frames])
    return FrontEnd(times_s, poses, failures, found_in(folder, detector))
