"""Chapters 3 and 5 of the thesis on photographs of things on a turntable (COIL-100, or whatever a folder holds)."""

from pathlib import Path

from semantic_slam_lab.studies.real_drives.drives import data_folder
from semantic_slam_lab.studies.real_turntables import chapter_3, chapter_5
from semantic_slam_lab.studies.real_turntables.claims import claims_of
from semantic_slam_lab.studies.real_turntables.classification import SAMPLES, SIGMAS_M
from semantic_slam_lab.studies.real_turntables.lookalikes import drawn, lookalike_pairs
from semantic_slam_lab.studies.real_turntables.measurement import NUM_PASSES
from semantic_slam_lab.studies.real_turntables.pages import figures_of, tables_of
from semantic_slam_lab.studies.real_turntables.photographs import Photographs, collected, read_photographs
from semantic_slam_lab.studies.real_turntables.trunk import plain_features, trunk_settings
from semantic_slam_lab.studies.result import write_result

NAME = "real_turntables"
DRAWS, QUICK_DRAWS = 20, 2
QUICK_OBJECTS = 12


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
    """Read, measure, fit and compare; returns the files written. Raises InputError."""
    from semantic_slam.pipeline.provenance import revision

    out.mkdir(parents=True, exist_ok=True)
    folder = data_folder(data)
    photographs = read_photographs(folder, pattern or "", mask_pattern or "")
    if quick:
        photographs = _some(photographs, folder)
    settings = trunk_settings(folder)
    plain = plain_features(settings, list(photographs.views), jobs)
    pairs = lookalike_pairs(photographs, plain.pooled)
    draws = drawn(photographs, pairs, QUICK_DRAWS if quick else DRAWS, seed)
    found = chapter_3.outcomes(photographs, plain.pooled, draws, settings, jobs, seed)
    result = {
        "study": NAME,
        "seed": seed,
        "config": {
            "trunk": settings.architecture,
            "objects": len(photographs.names),
            "views": len(photographs.views),
            "num_passes": NUM_PASSES,
            "samples_of_track": SAMPLES,
            "sigmas_m": SIGMAS_M,
        },
        "revision": revision(),
        "quick": quick,
        "pairs": [{"names": list(pair.names), "similarity": pair.similarity} for pair in pairs],
        "draws": [list(draw.names) for draw in draws],
        "classification": chapter_3.numbers(found),
        "ambiguity": chapter_3.ambiguity(draws, found),
        "latent": chapter_5.numbers(photographs, plain.layout, folder, quick=quick, jobs=jobs, seed=seed),
    }
    figures = figures_of(out, photographs, pairs, draws, found)
    return write_result(out, result, claims_of(result), tables_of(result), figures)


def _some(photographs: Photographs, folder: Path) -> Photographs:
    """The first objects alone."""
    names = photographs.names[:QUICK_OBJECTS]
    return collected([view for view in photographs.views if view.class_name in names], folder)
