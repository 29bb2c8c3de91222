"""The map prior: objects known before the run, in the format of ``objects.json``."""

import base64
import binascii
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.configuration.configuration import PLANAR, STATE_SPACES
from semantic_slam.errors import InputError
from semantic_slam.foreign_numbers import is_finite
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.object_coordinates import object_coordinates
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.world.identities import default_name
from semantic_slam.text_files import parse_json, read_text

ID_LIMIT = 2**32
ROUNDING = 1e-6
"""Relative tolerance for numbers read from files, which are rounded."""
LEAST_TOLERANCE = 1e-30
"""Absolute tolerance of a covariance whose variances are all 0."""
MOST_VARIANCE = 1e12
"""Largest variance [m^2 or rad^2]: beside it a known direction of the same pose would be lost to rounding."""


@dataclass(frozen=True, kw_only=True)
class ObjectPrior:
    """Prior of one mapped object: a Gaussian over its pose in map, class probabilities, existence and descriptor."""

    object_id: int  # 0 <= id < 2^32, unique in the map
    name: str
    pose: Array  # (7,) x y z qx qy qz qw
    covariance: Array  # (6, 6) x y z rx ry rz along the axes of map, as in PoseWithCovariance
    class_probabilities: dict[str, float]  # {} = uniform over the classes of the belief
    existence: float = 1.0
    descriptor: Array = field(default_factory=lambda: np.zeros(0))  # (L,) in a learned latent space; empty: not known
    descriptor_variance: Array = field(default_factory=lambda: np.zeros(0))  # (L,)

    @classmethod
    def planar(
        cls,
        object_id: int,
        x_m: float,
        y_m: float,
        yaw_rad: float = 0.0,
        *,
        sigma_m: float,
        sigma_rad: float,
        name: str = "",
        class_probabilities: dict[str, float] | None = None,
        existence: float = 1.0,
    ) -> "ObjectPrior":
        """Prior of an object in the plane from isotropic standard deviations of its position and its heading.

        Raises InputError for a standard deviation below 0.
        """
        _check_sigmas(object_id, sigma_m=sigma_m, sigma_rad=sigma_rad)
        covariance = covariance_from_planar(np.diag([sigma_m**2, sigma_m**2, sigma_rad**2]))
        pose = pose_vector_from_planar(np.array([x_m, y_m, yaw_rad]))
        return cls(
            object_id=object_id,
            name=name or default_name(object_id),
            pose=pose,
            covariance=covariance,
            class_probabilities=class_probabilities or {},
            existence=existence,
        )

    @classmethod
    def point(
        cls, object_id: int, position: Sequence[float], *, sigma_m: float, name: str = "", existence: float = 1.0
    ) -> "ObjectPrior":
        """Prior of a point landmark at (3,) x, y, z [m], isotropic; its orientation has no meaning.

        Raises InputError for a standard deviation below 0.
        """
        _check_sigmas(object_id, sigma_m=sigma_m)
        return cls(
            object_id=object_id,
            name=name or default_name(object_id),
            pose=np.array([*position, 0.0, 0.0, 0.0, 1.0], dtype=np.float64),
            covariance=np.diag([sigma_m**2] * 3 + [0.0] * 3),
            class_probabilities={},
            existence=existence,
        )


def _check_sigmas(object_id: int, **sigmas: float) -> None:
    """Raise InputError for what is no standard deviation."""
    for name, sigma in sigmas.items():
        if not (is_finite(sigma) and sigma >= 0.0):
            raise InputError(f"object {object_id}: {name} is {sigma!r}; give a standard deviation of 0 or more")


@dataclass(frozen=True)
class MapPrior:
    """Map prior: the known objects, in the frame ``map``."""

    objects: tuple[ObjectPrior, ...] = ()
    descriptor_space: str = ""  # name of the learned latent space of the descriptors
    joint_covariance: Array | None = None  # (3 O, 3 O) x y yaw, or in space x y z, of all objects, along the axes of
    # map; None: independent
    map_id: str = ""  # id of the FILE.map from which the prior was made
    state_space: str = PLANAR  # of the run that mapped them: planar or spatial
    ancestors: tuple[str, ...] = ()  # sorted ids of maps and recordings that it holds information of, besides map_id

    def to_json(self) -> str:
        """The text of an ``objects.json``."""
        return json.dumps(self.document(), indent=1)

    def document(self) -> dict[str, Any]:
        """What an ``objects.json`` holds; a joint covariance is base64-encoded, as in a FILE.map."""
        space = {"descriptor_space": self.descriptor_space} if self.descriptor_space else {}
        joint = {} if self.joint_covariance is None else {"joint_covariance": _packed(self.joint_covariance)}
        known: dict[str, Any] = {"map_id": self.map_id} if self.map_id else {}
        if self.ancestors:
            known["ancestors"] = list(self.ancestors)
        told = {"state_space": self.state_space} if self.state_space != PLANAR else {}
        rows = [_row(prior) for prior in self.objects]
        head = {"schema_version": 1, "frame": "map", **told, **known, **space, **joint}
        return {**head, "objects": rows}


def _row(prior: ObjectPrior) -> dict[str, Any]:
    learned = {"descriptor": prior.descriptor.tolist(), "descriptor_variance": prior.descriptor_variance.tolist()}
    return {
        "id": prior.object_id,
        "name": prior.name,
        "frame": "map",
        "pose": prior.pose.tolist(),
        "covariance": prior.covariance.tolist(),
        "class_probabilities": prior.class_probabilities,
        "existence": prior.existence,
        **(learned if len(prior.descriptor) else {}),
    }


def parse_map_prior(text: str, origin: str) -> MapPrior:
    """Map prior from the text of an ``objects.json``; raises InputError that names ``origin``."""
    try:
        document = parse_json(text)
        _check_frame(document)
        objects = tuple(_object(row) for row in document["objects"])
        space, state_space = str(document.get("descriptor_space", "")), _state_space(document)
        joint = _joint(document.get("joint_covariance"), objects, state_space)
        map_id, ancestors = str(document.get("map_id", "")), _ids(document.get("ancestors", []))
    except (ValueError, KeyError, TypeError, OverflowError) as fault:
        reason = " ".join(repr(fault).split())[:200]
        raise InputError(
            f"{origin}: not a map prior ({reason}); give an objects.json of a report, or what semantic_slam map save"
            " writes"
        ) from None
    ids = [prior.object_id for prior in objects]
    if len(set(ids)) < len(ids):
        raise InputError(f"{origin}: object ids are not unique; number the objects anew")
    return MapPrior(objects, space, joint, map_id, state_space, ancestors)


def read_map_prior(path: Path) -> MapPrior:
    """Map prior from an ``objects.json``; raises InputError when it cannot be read."""
    return parse_map_prior(read_text(path, "name an existing objects.json"), str(path))


def _object(row: dict[str, object]) -> ObjectPrior:
    _check_frame(row)
    object_id = int(str(row["id"]))
    if not 0 <= object_id < ID_LIMIT:
        raise ValueError(f"id {object_id} is not in 0 to {ID_LIMIT - 1}")
    return ObjectPrior(
        object_id=object_id,
        name=str(row.get("name", row["id"])),
        pose=_pose(row["pose"]),
        covariance=_covariance(row["covariance"]),
        class_probabilities=_class_probabilities(row.get("class_probabilities")),
        existence=_existence(row.get("existence", 1.0)),
        **_descriptor(row),
    )


def _ids(values: object) -> tuple[str, ...]:
    """Ids of maps. Raises ValueError where they are no texts."""
    if not isinstance(values, list) or not all(isinstance(own, str) for own in values):
        raise ValueError("ancestors is no list of map ids")
    return tuple(values)


def _state_space(document: dict[str, object]) -> str:
    """The state space of a map; that of files which do not state it is the plane. Raises ValueError."""
    told = document.get("state_space", PLANAR)
    if told not in STATE_SPACES:
        raise ValueError(f"state_space is {told!r}, and must be one of {', '.join(STATE_SPACES)}")
    return str(told)


def _check_frame(values: dict[str, object]) -> None:
    if not isinstance(values, dict):
        raise TypeError("a mapping is expected")
    if values.get("frame", "map") != "map":
        raise ValueError(f"frame is {values['frame']!r}, and must be 'map'")


def _descriptor(row: dict[str, object]) -> dict[str, Array]:
    names = ("descriptor", "descriptor_variance")
    mean, variance = (np.asarray(row.get(name, ()), dtype=np.float64) for name in names)
    if mean.ndim != 1 or mean.shape != variance.shape or not np.isfinite(mean).all() or not (variance > 0.0).all():
        raise ValueError("a descriptor needs finite numbers, and as many positive variances")
    return {"descriptor": mean, "descriptor_variance": variance}


def _pose(values: object) -> Array:
    pose = np.asarray(values, dtype=np.float64)
    if pose.shape != (7,) or not np.isfinite(pose).all():
        raise ValueError("pose needs 7 finite numbers")
    length = float(np.linalg.norm(pose[3:]))
    if length < ROUNDING:
        raise ValueError("the quaternion of a pose is zero")
    if abs(length - 1.0) > 1e-12:  # else left bit-identical, as backends parse again what the manager has parsed
        pose[3:] /= length
    return pose


def _covariance(values: object) -> Array:
    covariance = np.asarray(values, dtype=np.float64)
    if covariance.size != 36 or not np.isfinite(covariance).all():
        raise ValueError("covariance needs 36 finite numbers")
    covariance = covariance.reshape(6, 6)
    if np.abs(covariance).max() > MOST_VARIANCE:
        raise ValueError(f"covariance has numbers above {MOST_VARIANCE:.0e}; give 1e6 where nothing is known")
    tolerance = ROUNDING * float(np.abs(covariance).max())
    if np.abs(covariance - covariance.T).max() > tolerance or np.linalg.eigvalsh(covariance).min() < -tolerance:
        raise ValueError("covariance is not symmetric and positive semi-definite")
    return covariance


def _existence(value: object) -> float:
    probability = float(str(value))
    if not 0.0 <= probability <= 1.0:
        raise ValueError(f"existence is {probability}, and must be a probability")
    return probability


def _class_probabilities(values: object) -> dict[str, float]:
    probabilities = {str(name): float(value) for name, value in dict(values or {}).items()}  # type: ignore[call-overload]
    if not all(0.0 <= value < math.inf for value in probabilities.values()):
        raise ValueError("class probabilities must be finite and not negative")
    if probabilities and not any(probabilities.values()):
        raise ValueError("class probabilities are all zero")
    return probabilities


def _packed(joint: Array) -> str:
    """A square matrix in base64: little-endian doubles, bit-exact."""
    return base64.b64encode(np.ascontiguousarray(joint, dtype="<f8").tobytes()).decode()


def _joint(text: object, objects: tuple[ObjectPrior, ...], state_space: str) -> Array | None:
    """(3 O, 3 O) joint covariance from base64 text, checked against the objects' own. Raises ValueError."""
    if text is None:
        return None
    size = 3 * len(objects)
    try:
        packed = base64.b64decode(str(text), validate=True)
    except binascii.Error:
        raise ValueError("joint_covariance is not in base64") from None
    if len(packed) != 8 * size**2:
        raise ValueError(f"joint_covariance needs {size} x {size} numbers")
    joint = np.frombuffer(packed, dtype="<f8").reshape(size, size).astype(np.float64)
    check_joint(joint, objects, state_space)
    return joint


def is_positive(square: Array, tolerance: float) -> bool:
    """Whether a symmetric matrix has no eigenvalue below -tolerance, by a Cholesky factorisation (faster)."""
    try:
        np.linalg.cholesky(square + max(tolerance, LEAST_TOLERANCE) * np.eye(len(square)))
    except np.linalg.LinAlgError:
        return False
    return True


def check_joint(joint: Array, objects: Sequence[ObjectPrior], state_space: str) -> None:
    """Raise ValueError if (3 O, 3 O) is no covariance, or its diagonal blocks are not the objects' own covariances."""
    if not np.isfinite(joint).all():
        raise ValueError("joint_covariance needs finite numbers")
    tolerance = ROUNDING * float(np.abs(joint).max(initial=0.0))
    if len(joint) and not (np.abs(joint - joint.T).max() <= tolerance and is_positive(joint, tolerance)):
        raise ValueError("joint_covariance is not symmetric and positive semi-definite")
    coordinates = object_coordinates(state_space)
    own = np.array([coordinates.of_covariances(item.covariance) for item in objects]).reshape(-1, 3, 3)
    rows = np.arange(len(joint)).reshape(-1, 3)
    if np.abs(joint[rows[:, :, None], rows[:, None, :]] - own).max(initial=0.0) > tolerance:
        raise ValueError("joint_covariance has other covariances than the objects")
