"""A folder laid out as the TUM RGB-D benchmark: a camera that looks at points whose places are known."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from worlds.bags.image_folder import CX, CY, FX, FY, HEIGHT, WIDTH, pictures

PERIOD_S = 0.5


def stamp_s(number):
    return 1000.0 + PERIOD_S * number


def pose_line(number, T_world_camera):
    row = [*T_world_camera[:3, 3], *Rotation.from_matrix(T_world_camera[:3, :3]).as_quat()]
    return " ".join([f"{stamp_s(number):.4f}", *(f"{value:.9f}" for value in row)])


def write_tum_folder(folder, poses, points, *, with_pictures=True):
    """The world's z axis up; boxes of every point in view, with their true ids; the last frame shows nothing."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    lines = {"rgb": ["# timestamp filename"], "depth": ["# timestamp filename"]}
    boxes = ["stamp_s,label,score,x_min,y_min,x_max,y_max,object_id"]
    for number, pose in enumerate(poses):
        colour, depth, _ = pictures(pose, points, 5000.0, 0)
        for name, picture, late in (("rgb", colour, 0.0), ("depth", depth, 0.01)):
            lines[name].append(f"{stamp_s(number) + late:.6f} {name}/{number}.png")
            if with_pictures:
                cv2.imwrite(str(folder / name / f"{number}.png"), picture)
        for row, point in enumerate(points if number < len(poses) - 1 else ()):
            for x, y, w, h in pictures(pose, [point], 5000.0, 0)[2]:
                boxes.append(f"{stamp_s(number):.6f},cup,0.9,{x:.3f},{y:.3f},{x + w:.3f},{y + h:.3f},{row}")
    for name, text in lines.items():
        (folder / f"{name}.txt").write_text("\n".join(text) + "\n")
    truth = [pose_line(number, pose) for number, pose in enumerate(poses)]
    (folder / "groundtruth.txt").write_text("\n".join(["# ground truth", *truth]) + "\n")
    (folder / "camera.txt").write_text(f"{FX} {FY} {CX} {CY} {WIDTH} {HEIGHT}\n")
    (folder / "detections.csv").write_text("\n".join(boxes) + "\n")
    objects = [f"{row},{x},{y},{z},cup" for row, (x, y, z) in enumerate(points)]
    (folder / "objects.csv").write_text("\n".join(["object_id,x,y,z,class", *objects]) + "\n")
    return np.asarray(points)
