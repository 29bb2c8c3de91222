"""Vectors of appearance of many things from all around: of photographs by a real trunk, or drawn."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.repetitions import keyed_generator

COIL_PATTERN = "{object}__{azimuth}.jpg"
DRAWN_THINGS, DRAWN_SIZE, DRAWN_DEG = 54, 512, 5.0
DRAWN_SPECTRUM = 0.5
"""Power by which the standard deviations of drawn vectors fall from component to component."""


@dataclass(frozen=True, kw_only=True)
class Thing:
    """One thing from V directions."""

    name: str
    azimuths: Array  # (V,) radians, in its own frame
    vectors: Array  # (V, F)

    def nearest(self, azimuth: float) -> int:
        """The view from the nearest direction."""
        return int(np.argmax(np.cos(self.azimuths - azimuth)))


@dataclass(frozen=True, kw_only=True)
class Gallery:
    """Things whose vectors are of one network."""

    network: str
    things: tuple[Thing, ...]


def photographed(data: Path, network: str) -> Gallery:
    """COIL-100 in ``data``/coil100, by the pooled trunk of an ImageNet network. Raises InputError."""
    from semantic_slam.datasets.turntables.photographs import by_pattern

    photographs = by_pattern(data / "coil100", COIL_PATTERN).photographs
    vectors = _trunk_features([own.file for own in photographs], _network(data, network))
    names = sorted({own.object_name for own in photographs})
    rows = {name: [row for row, own in enumerate(photographs) if own.object_name == name] for name in names}
    return Gallery(
        network=network,
        things=tuple(
            Thing(
                name=name,
                azimuths=np.deg2rad([photographs[row].azimuth_deg for row in rows[name]]),
                vectors=vectors[rows[name]],
            )
            for name in names
        ),
    )


def _network(data: Path, name: str):  # type: ignore[no-untyped-def]  # torch is not followed by mypy
    from semantic_slam.configuration import PerceptionConfiguration
    from semantic_slam.perception.networks.weights import load_network

    path = data / "weights" / "squeezenet_v1.1.pth" if name == "squeezenet" else ""
    return load_network(PerceptionConfiguration(architecture=name, network=str(path), classes=("0",))).network


def _trunk_features(files: list[Path], network) -> Array:  # type: ignore[no-untyped-def]
    """(N, F) means over the places of the trunk's last map."""
    import cv2
    from tqdm import tqdm

    from semantic_slam.messages.picture_files import read_picture
    from semantic_slam.perception.networks.mc_dropout import trunk_features

    size, found = (network.input_size, network.input_size), []
    for file in tqdm(files, desc="pictures", unit="picture"):
        picture = np.ascontiguousarray(read_picture(file, cv2.IMREAD_COLOR)[..., ::-1])
        found.append(trunk_features(network, cv2.resize(picture, size)[None])[0])
    return np.array(found, dtype=np.float64)


def drawn(seed: int) -> Gallery:
    """Vectors in a narrow cone, as those of large networks are, whose views change smoothly as they turn."""
    random = keyed_generator("embeddings", "gallery", seed)
    sigmas: Array = np.arange(1, DRAWN_SIZE + 1, dtype=np.float64) ** -DRAWN_SPECTRUM
    sigmas /= float(np.sqrt((sigmas**2).sum()))
    cone = random.normal(size=DRAWN_SIZE) / np.sqrt(DRAWN_SIZE)
    return Gallery(
        network="drawn", things=tuple(_drawn(number, cone, sigmas, random) for number in range(DRAWN_THINGS))
    )


def _drawn(number: int, cone: Array, sigmas: Array, random: np.random.Generator) -> Thing:
    """A look of its own, and waves about it with a strength of its own."""
    azimuths = np.deg2rad(np.arange(0.0, 360.0, DRAWN_DEG))
    waves = np.concatenate([[np.cos(k * azimuths) / k, np.sin(k * azimuths) / k] for k in range(1, 6)])  # (10, V)
    share = random.choice([0.03, 0.1, 0.25, 0.45])
    look, turning = random.normal(size=DRAWN_SIZE) * sigmas, random.normal(size=(len(waves), DRAWN_SIZE)) * sigmas
    own = random.normal(size=(len(azimuths), DRAWN_SIZE)) * sigmas
    power = (waves**2).sum(axis=0).mean()
    about = np.sqrt(0.85 * share / power) * waves.T @ turning + np.sqrt(0.15 * share) * own
    return Thing(name=f"thing_{number}", azimuths=azimuths, vectors=cone + 0.6 * (np.sqrt(1.0 - share) * look + about))
