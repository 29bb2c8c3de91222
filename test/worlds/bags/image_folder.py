"""A folder of colour and depth pictures, laid out as CubeSLAM or 7-Scenes, of things whose places are known."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT = 160, 120
FX, FY, CX, CY = 140.0, 140.0, 80.0, 60.0
PATCH_PX = 6
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""R_level_optical of a camera that looks along x."""


def hand_held(planar, pitch_rad, roll_rad, height_m, R_world_level):
    """(4, 4) T_world_camera of a camera at (x, y, yaw) in a level frame that the world leans against."""
    level = Rotation.from_euler("ZYX", [planar[2], pitch_rad, roll_rad]).as_matrix()
    pose = np.eye(4)
    pose[:3, :3] = R_world_level @ level @ OPTICAL
    pose[:3, 3] = R_world_level @ [planar[0], planar[1], height_m]
    return pose


def seen(T_world_camera, point):
    """Depth and pixel of a world's point; None outside the picture."""
    x, y, z = T_world_camera[:3, :3].T @ (point - T_world_camera[:3, 3])
    if z <= 0.1:
        return None
    u, v = FX * x / z + CX, FY * y / z + CY
    inside = PATCH_PX < u < WIDTH - PATCH_PX and PATCH_PX < v < HEIGHT - PATCH_PX
    return (z, u, v) if inside else None


def pictures(T_world_camera, points, per_metre, invalid):
    """Colour and depth pictures with a patch for each point, and the boxes of those patches (x y w h)."""
    colour = np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8)
    depth = np.full((HEIGHT, WIDTH), invalid, dtype=np.uint16)
    boxes = []
    for point in points:
        shown = seen(T_world_camera, point)
        if shown is None:
            continue
        z, u, v = shown
        rows = slice(round(v) - PATCH_PX, round(v) + PATCH_PX + 1)
        columns = slice(round(u) - PATCH_PX, round(u) + PATCH_PX + 1)
        depth[rows, columns], colour[rows, columns] = round(z * per_metre), (40, 60, 200)
        boxes.append((u - PATCH_PX, v - PATCH_PX, 2 * PATCH_PX, 2 * PATCH_PX))
    return colour, depth, boxes


def write_cube_slam(folder, poses, points):
    """As CubeSLAM has it, the world's z axis up; with ``camera.txt`` and one box for each point in view."""
    for name in ("raw_imgs", "depth_imgs", "filter_2d_obj_txts"):
        (folder / name).mkdir(parents=True)
    lines = []
    for number, pose in enumerate(poses):
        colour, depth, boxes = pictures(pose, points, 5000.0, 0)
        cv2.imwrite(str(folder / "raw_imgs" / f"{number:04d}_rgb_raw.jpg"), colour)
        cv2.imwrite(str(folder / "depth_imgs" / f"{number:04d}_depth_raw.png"), depth)
        text = "".join("\t".join(f"{value:.4f}" for value in (*box, 0.9)) + "\n" for box in boxes)
        (folder / "filter_2d_obj_txts" / f"{number:04d}_yolo2_0.15.txt").write_text(text)
        row = [100.0 + 0.5 * number, *pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
        lines.append("\t".join(f"{value:.9f}" for value in row) + "\t\n")
    (folder / "truth_cam_poses.txt").write_text("".join(lines))
    (folder / "camera.txt").write_text(f"{FX} {FY} {CX} {CY} {WIDTH} {HEIGHT}\n")


def write_seven_scenes(folder, poses, points, down):
    """As 7-Scenes has it, every fourth frame, with ``gravity-direction.txt``."""
    folder.mkdir(parents=True)
    for number, pose in enumerate(poses):
        colour, depth, _ = pictures(pose, points, 1000.0, 65535)
        stem = folder / f"frame-{4 * number:06d}"
        cv2.imwrite(f"{stem}.color.jpg", colour)
        cv2.imwrite(f"{stem}.depth.png", depth)
        np.savetxt(f"{stem}.pose.txt", pose)
    np.savetxt(folder / "camera-intrinsics.txt", [[FX, 0.0, CX], [0.0, FY, CY], [0.0, 0.0, 1.0]])
    np.savetxt(folder / "gravity-direction.txt", down)
