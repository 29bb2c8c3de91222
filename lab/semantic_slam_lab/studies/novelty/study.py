"""Is a picture of something that no class model knows told from the known objects, at which false alarms?

Photographs on a turntable (COIL-100, or whatever a folder holds) are shown alone, and in random rooms. In each draw
some objects are known, by views every 20 degrees; new views of them, half a step between those, are the false alarms.
All other objects, pictures of noise and coloured blocks are to be called unknown.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Index
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.novelty.curves import METHODS, RATES, curve_of, scores_of, separation
from semantic_slam_lab.studies.novelty.features import NETWORKS, SHIPPED, Measured, measured
from semantic_slam_lab.studies.novelty.pages import claims_of, figure_of, tables_of
from semantic_slam_lab.studies.real_drives.drives import data_folder
from semantic_slam_lab.studies.real_turntables.photographs import Photographs, read_photographs
from semantic_slam_lab.studies.result import write_result

NAME = "novelty"
KNOWN_OBJECTS = 12
DRAWS, QUICK_DRAWS = 20, 3
OTHERS, QUICK_OTHERS = 200, 50
MADE_UP, QUICK_MADE_UP = 600, 100


def run(
    out: Path,
    *,
    quick: bool,
    jobs: int,
    seed: int,
    data: Path | None = None,
    pattern: str | None = None,
    mask_pattern: str | None = None,
) -> list[Path]:
    """Read, measure, fit and score; returns the files written. Raises InputError."""
    from semantic_slam.pipeline.provenance import revision

    out.mkdir(parents=True, exist_ok=True)
    folder = data_folder(data)
    photographs = read_photographs(folder, pattern or "", mask_pattern or "")
    if len(photographs.names) < 2 * KNOWN_OBJECTS:
        raise InputError(f"{folder}: {len(photographs.names)} objects; {2 * KNOWN_OBJECTS} at least are needed")
    draws = [_known(photographs, seed, number) for number in range(QUICK_DRAWS if quick else DRAWS)]
    networks = {
        name: {setting: _evaluated(seen, draws) for setting, seen in settings.items()}
        for name, settings in _measured(photographs, folder, quick=quick, jobs=jobs)
    }
    result = {
        "study": NAME,
        "seed": seed,
        "config": {
            "objects": len(photographs.names),
            "known": KNOWN_OBJECTS,
            "draws": len(draws),
            "made_up": QUICK_MADE_UP if quick else MADE_UP,
            "others": QUICK_OTHERS if quick else OTHERS,
            "rates": list(RATES),
        },
        "revision": revision(),
        "quick": quick,
        "networks": networks,
    }
    figure = figure_of(out / "novelty.png", networks)
    return write_result(out, result, claims_of(networks), tables_of(networks), [figure])


def _known(photographs: Photographs, seed: int, number: int) -> Index:
    """Numbers of the objects that are known in a draw."""
    return keyed_generator(NAME, "draw", seed, number).permutation(len(photographs.names))[:KNOWN_OBJECTS]


def _measured(
    photographs: Photographs, data: Path, *, quick: bool, jobs: int
) -> Iterator[tuple[str, dict[str, Measured]]]:
    """Every network with what it makes of the photographs."""
    counts = (QUICK_OTHERS, QUICK_MADE_UP) if quick else (OTHERS, MADE_UP)
    for name in (SHIPPED,) if quick else NETWORKS:
        yield name, measured(photographs, name, data, *counts, jobs)


def _evaluated(seen: Measured, draws: list[Index]) -> dict[str, Any]:
    """Curve and area by method."""
    scores = [scores_of(seen, known) for known in draws]
    by_method = {method: [own[method] for own in scores] for method in METHODS}
    return {method: {"curve": curve_of(own), "area": separation(own)} for method, own in by_method.items()}
