"""Vectors of appearance: is what is looked for found, with honest probabilities, and does association gain by them?

Nothing is fitted. Vectors are drawn, and where there is data they are those of photographs (COIL-100) by the trunk of
an ImageNet network, as stand-ins for CLIP's; questions are views that the map has not seen, and things that it has not.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam_lab.repetitions import own_numbers, repeat
from semantic_slam_lab.studies.embeddings import texts
from semantic_slam_lab.studies.embeddings.drives import METHODS, driven
from semantic_slam_lab.studies.embeddings.gallery import Gallery, drawn, photographed
from semantic_slam_lab.studies.embeddings.questions import PASSES, Asked, asked_of_map, scores
from semantic_slam_lab.studies.result import Claim, Table, required, write_result

NAME = "embeddings"
DATA = "SEMANTIC_SLAM_DATA"
MAPS, QUICK_MAPS = 10, 2
ROOMS, QUICK_ROOMS = 10, 1
NUM_KEYFRAMES, QUICK_KEYFRAMES = 48, 16
GROUPS = ("all", "between", "elsewhere", "not mapped")
NETWORK = "squeezenet"


def run(out: Path, *, quick: bool, jobs: int, seed: int, data: Path | None = None) -> list[Path]:
    """Maps, texts and rooms of drawn vectors, and of photographs where there are any; returns the files written."""
    from semantic_slam.pipeline.provenance import revision

    galleries = [drawn(seed), *_of_photographs(data)]
    found = {gallery.network: _evaluated(gallery, quick=quick, jobs=jobs, seed=seed) for gallery in galleries}
    named = _named(galleries[0], QUICK_MAPS if quick else MAPS, jobs, seed)
    result = {
        "study": NAME,
        "seed": seed,
        "config": {"maps": QUICK_MAPS if quick else MAPS, "rooms": QUICK_ROOMS if quick else ROOMS},
        "revision": revision(),
        "quick": quick,
        "galleries": found,
        "texts": named,
    }
    return write_result(out, result, _claims(found), _tables(found, named))


def _of_photographs(data: Path | None) -> list[Gallery]:
    """None where nobody says where the data are."""
    folder = data or (Path(os.environ[DATA]) if os.environ.get(DATA) else None)
    return [photographed(folder, NETWORK)] if folder is not None and (folder / "coil100").is_dir() else []


def _evaluated(gallery: Gallery, *, quick: bool, jobs: int, seed: int) -> dict[str, Any]:
    """Scores by pass, method and group of questions; and of rooms by method."""
    maps, rooms = (QUICK_MAPS, QUICK_ROOMS) if quick else (MAPS, ROOMS)
    tasks = [(gallery, name, number) for name in PASSES for number in own_numbers(seed, maps, MAPS)]
    every = repeat(asked_of_map, tasks, jobs, f"{gallery.network}: maps")
    by_pass = {name: list[Asked]() for name in PASSES}
    for (_, name, _), asked_there in zip(tasks, every, strict=True):
        by_pass[name] += asked_there
    passes = {name: _by_group(own) for name, own in by_pass.items()}
    length = QUICK_KEYFRAMES if quick else NUM_KEYFRAMES
    drives = [(gallery, number, length) for number in own_numbers(seed, rooms, ROOMS)]
    driven_rooms = repeat(driven, drives, jobs, f"{gallery.network}: rooms")
    methods = {
        method: {
            name: float(np.mean([metrics[method][name] for metrics, _ in driven_rooms]))
            for name in driven_rooms[0][0][method]
        }
        for method in METHODS
    }
    asked = [one for _, own in driven_rooms for one in own]
    groups = sorted({one.group for one in asked})
    return {
        "passes": passes,
        "methods": {"ours": {"method": METHODS[0], **methods[METHODS[0]]}, **methods},
        "room_questions": {group: scores([one for one in asked if one.group == group], "ours") for group in groups},
    }


def _by_group(asked: list[Asked]) -> dict[str, dict[str, dict[str, float]]]:
    """Method -> group -> scores, of the groups that there are."""
    parts = {group: [one for one in asked if group in ("all", one.group)] for group in GROUPS}
    return {
        method: {group: scores(own, method) for group, own in parts.items() if own} for method in ("ours", "cosine")
    }


def _named(gallery: Gallery, maps: int, jobs: int, seed: int) -> dict[str, dict[str, float]]:
    """Scores of questions by text, by how well texts point at what they name."""
    tasks = [(gallery, pointing, number) for pointing in texts.POINTING for number in own_numbers(seed, maps, MAPS)]
    every = repeat(texts.named_on_map, tasks, jobs, "texts")
    return {
        pointing: texts.scores(
            [one for task, own in zip(tasks, every, strict=True) if task[1] == pointing for one in own]
        )
        for pointing in texts.POINTING
    }


def _claims(found: dict[str, Any]) -> list[Claim]:
    claims = []
    for network, part in found.items():
        for name, own in part["passes"].items():
            whole = own["ours"]["all"]
            what = f"{network}, things passed {name}: find_objects by vector"
            claims += [
                required(f"{what} right for ≥ 95 %", f"{whole['right']:.3f}", whole["right"] >= 0.95),
                required(f"{what} calibrated, ECE ≤ 0.05", f"{whole['ece']:.3f}", whole["ece"] <= 0.05),
            ]
        f1 = {method: part["methods"][method]["association_f1"] for method in METHODS}
        measured = ", ".join(f"{method} {value:.3f}" for method, value in f1.items())
        text = f"{network}: detections are associated no worse with vectors than without"
        claims.append(required(text, measured, f1["embedding"] >= f1["none"]))
    return claims


def _tables(found: dict[str, Any], named: dict[str, dict[str, float]]) -> list[Table]:
    columns = ("vectors", "passed", "method", "questions", "number", "right", "ECE", "NLL")
    rows = [
        (network, name, method, group, *_cells(own, ("num_questions", "right", "ece", "nll")))
        for network, part in found.items()
        for name, methods in part["passes"].items()
        for method, groups in methods.items()
        for group, own in groups.items()
    ]
    driven_rooms = [
        (network, method, *_cells(own, ("association_f1", "num_objects", "num_true_objects")))
        for network, part in found.items()
        for method, own in part["methods"].items()
        if method != "ours"
    ]
    asked = [
        (network, group, *_cells(own, ("num_questions", "right", "ece", "nll")))
        for network, part in found.items()
        for group, own in part["room_questions"].items()
    ]
    spoken = [(name, *_cells(own, ("right_mapped", "right_not_mapped", "ece"))) for name, own in named.items()]
    return [
        Table("Questions by vector", columns, tuple(rows)),
        Table("Rooms, association unknown", ("vectors", "method", "F1", "objects", "true ones"), tuple(driven_rooms)),
        Table("Questions to those rooms", ("vectors", "questions", "number", "right", "ECE", "NLL"), tuple(asked)),
        Table("Questions by text, drawn", ("texts point", "right, mapped", "right, not mapped", "ECE"), tuple(spoken)),
    ]


def _cells(own: dict[str, float], names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{own[name]:.3g}" for name in names)
