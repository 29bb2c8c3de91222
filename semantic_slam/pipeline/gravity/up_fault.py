"""What is said of an up direction that is far from the body's z axis, by a run and by the doctor."""

import numpy as np

from semantic_slam.geometry.arrays import Array

ON_ITS_SIDE_RAD, UPSIDE_DOWN_RAD = np.radians(60.0), np.radians(120.0)
"""Angles between up and the body's z axis from which the sensor counts as tilted, and as upside down."""
AXES = ("x", "y", "z", "-x", "-y", "-z")
SHOWS = "a level sensor shows +9.81 m/s^2 along its axis that points up (REP 145)"
MOUNT = "give its pose in the body by /tf_static or imu.extrinsics"


def angle_between(a: Array, b: Array) -> float:
    """Angle [rad] between two directions (3,) of any length."""
    lengths = max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-12)
    return float(np.arccos(np.clip(a @ b / lengths, -1.0, 1.0)))


def off_z(up: Array) -> float:
    """Angle [rad] between a direction (3,) in the body and the body's z axis."""
    return angle_between(up, np.array([0.0, 0.0, 1.0]))


def up_fault(topic: str, up: Array) -> tuple[str, str]:
    """Fault and remedy of a unit vector (3,) up in the body frame; two empty texts if it is roughly the body's z."""
    off = off_z(up)
    if off <= ON_ITS_SIDE_RAD:
        return "", ""
    what = f"{topic}: up is along {AXES[int(np.argmax([*up, *-up]))]} of the body, {np.degrees(off):.0f} deg off z"
    remedy = f"{MOUNT}; {SHOWS}"
    return what, remedy if off > UPSIDE_DOWN_RAD else f"{remedy}; of a body that is carried so this is right"
