"""Rooms in which two different instances of each class stand: descriptors against classes, association unknown."""

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration, PerceptionConfiguration, SemanticModelConfiguration, to_dict
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam_lab.repetitions import own_numbers, repeat
from semantic_slam_lab.studies.ch5.models import NUM_GOODS
from semantic_slam_lab.studies.latent_slam.maps import unannotated, with_classes, with_instances
from semantic_slam_lab.studies.result import Claim, Table, write_result

NAME = "latent_slam"
ROOMS, QUICK_ROOMS = 10, 1
QUICK_KEYFRAMES = 12
IMAGE_WIDTH = 720
METRICS = (
    "association_right",
    "association_f1",
    "ate_m",
    "dead_reckoning_ate_m",
    "keyframe_disambiguated",
)
MAPS = {
    "poses": "the map has poses alone",
    "names": "the map has poses and what stands there: an instance for descriptors, its class for the classifier",
}


METHODS = {"latent": "descriptors", "classes": "classes", "no_semantics": "geometry alone"}


@dataclass(frozen=True)
class RoomResult:
    """Metrics of one room: map -> method -> metric."""

    room: int
    num_keyframes: int
    maps: dict[str, dict[str, dict[str, float | None]]]


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render, import, run every method with every map; returns the files written."""
    from semantic_slam.pipeline.provenance import revision

    rooms = [1 + number for number in own_numbers(seed, QUICK_ROOMS if quick else ROOMS, ROOMS)]
    limit = QUICK_KEYFRAMES if quick else None
    results = repeat(evaluate_room, [(out / f"room_{number}", number, limit) for number in rooms], jobs, "rooms")
    summary = {name: _means(results, name) for name in MAPS}
    result = {
        "study": NAME,
        "seed": seed,
        "config": {"rooms": len(results), "goods": NUM_GOODS, "configuration": to_dict(configurations()["latent"])},
        "revision": revision(),
        "quick": quick,
        "methods": summary["names"],
        "maps": summary,
        "rooms": [vars(room) for room in results],
    }
    tables = [_table(name, text, results) for name, text in MAPS.items()]
    return write_result(out, result, _claims(results), tables)


def configurations() -> dict[str, Configuration]:
    """The learned latent space, the classifier of the same goods, and geometry alone."""
    from semantic_slam.perception.networks.weight_files import shipped_file

    plain = Configuration()
    classes = SemanticModelConfiguration(path=str(shipped_file("goods_viewpoint_models.safetensors")))
    network = PerceptionConfiguration(network=str(shipped_file("goods_network.safetensors")))
    return {
        "latent": replace(plain, semantic_model=SemanticModelConfiguration(kind="latent"), perception=network),
        "classes": replace(plain, semantic_model=classes, perception=network),
        "no_semantics": replace(plain, semantic_model=SemanticModelConfiguration(kind="none"), perception=network),
    }


def evaluate_room(folder: Path, number: int, max_keyframes: int | None) -> RoomResult:
    """One room, from rendering to metrics."""
    from semantic_slam.datasets.avd.avd_import import import_avd
    from semantic_slam.datasets.avd.drive import ImportSettings
    from semantic_slam.inference.world.map_prior import read_map_prior
    from semantic_slam_lab.simulation.layout import draw_layout
    from semantic_slam_lab.simulation.scene import SceneSettings, make_scene

    bag = folder / "bag"
    with TemporaryDirectory() as rendered:
        scene = make_scene(Path(rendered), number, SceneSettings(tour_only=True, goods=NUM_GOODS))
        import_avd(scene, bag, None, max_keyframes, number, ImportSettings(image_width=IMAGE_WIDTH))
    plain = unannotated(read_map_prior(bag / "objects.json"))
    instances = {placed.object_id: placed.class_name for placed in draw_layout(number, NUM_GOODS)}
    priors = {
        "poses": {name: plain for name in configurations()},
        "names": {"latent": with_instances(plain, instances), "classes": with_classes(plain, instances)},
    }
    maps: dict[str, dict[str, dict[str, float | None]]] = {}
    num_keyframes = 0
    for told, of_map in priors.items():
        maps[told] = {}
        for name, prior in of_map.items():
            maps[told][name], num_keyframes = _metrics(bag, folder / told / name, configurations()[name], prior)
    maps["names"]["no_semantics"] = maps["poses"]["no_semantics"]
    return RoomResult(number, num_keyframes, maps)


def _metrics(
    bag: Path, out: Path, configuration: Configuration, prior: MapPrior
) -> tuple[dict[str, float | None], int]:
    import json

    from semantic_slam.pipeline.offline import run_bag
    from semantic_slam.report.make import make_report

    summary = run_bag(bag, out / "belief", configuration, prior)
    make_report(out / "belief", out, source_bag=bag)
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    return {name: report["metrics"].get(name) for name in METRICS}, summary.num_keyframes


def _means(results: list[RoomResult], told: str) -> dict[str, dict[str, Any]]:
    """Method -> metric -> mean over the rooms, the default named ``ours``."""
    summary: dict[str, dict[str, Any]] = {}
    for method in results[0].maps[told]:
        rows = [room.maps[told][method] for room in results]
        columns = {name: [row[name] for row in rows if row[name] is not None] for name in METRICS}
        summary[method] = {name: float(np.mean(values)) if values else None for name, values in columns.items()}  # type: ignore[arg-type]
        summary[method]["rooms_never_disambiguated"] = sum(row["keyframe_disambiguated"] is None for row in rows)
    return {"ours": {"method": "latent", **summary["latent"]}, **summary}


def _claims(results: list[RoomResult]) -> list[Claim]:
    claims = []
    for told, text in MAPS.items():
        right = {name: _mean(results, told, name, "association_right", 0.0) for name in configurations()}
        settled = {name: _settled(results, told, name) for name in configurations()}
        never, _ = settled["latent"]
        shares = {name: f"{value:.3g}" for name, value in right.items()}
        times = {name: f"at {median:.3g}, never in {count} rooms" for name, (count, median) in settled.items()}
        statements = (
            ("associate as well as", shares, right["latent"] >= right["classes"]),
            (
                "settle the association no later than",
                times,
                never < len(results) and settled["latent"] <= settled["classes"],
            ),
        )
        for words, values, holds in statements:
            measured = ", ".join(f"{METHODS[name]} {value}" for name, value in values.items())
            claims.append(Claim(f"Descriptors {words} classes, where {text}", "project", "", measured, holds))
    return claims


def _mean(results: list[RoomResult], told: str, method: str, metric: str, missing: float) -> float:
    """Mean of a metric over the rooms, ``missing`` where a room has no such number."""
    values = [room.maps[told][method][metric] for room in results]
    return float(np.mean([missing if value is None else value for value in values]))


def _settled(results: list[RoomResult], told: str, method: str) -> tuple[int, float]:
    """Number of rooms that never settle, and the median keyframe of those that do: the smaller pair settles sooner."""
    every = [room.maps[told][method]["keyframe_disambiguated"] for room in results]
    found = [keyframe for keyframe in every if keyframe is not None]
    return len(every) - len(found), float(np.median(found)) if found else np.inf


def _table(told: str, text: str, results: list[RoomResult]) -> Table:
    columns = ("room", "method", *(name.replace("_", " ") for name in METRICS))
    rows = tuple(
        (str(room.room), method, *(_text(values[name]) for name in METRICS))
        for room in results
        for method, values in room.maps[told].items()
    )
    return Table(text[0].upper() + text[1:], columns, rows)


def _text(value: float | None) -> str:
    return "never" if value is None else f"{value:.3g}"
