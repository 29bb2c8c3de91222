"""``semantic_slam find BELIEF --place``: list the objects in a region, and the expected ones missing there."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from semantic_slam.answers.query_place import PlacedObject
    from semantic_slam.answers.region import Region
    from semantic_slam.inference.belief import HybridBelief


def ask(belief: Path, region: "Region | None", least_probability: float) -> None:
    """Print the objects in the region, and those gone from it; raises InputError."""
    from semantic_slam.answers.query_place import query_place
    from semantic_slam.evaluation.belief_bag import read_record
    from semantic_slam.inference.world.map_prior import parse_map_prior

    record = read_record(belief)
    prior = parse_map_prior(record.run.map_prior, str(belief)) if record.run.map_prior else None
    last = record.beliefs[-1]
    print("\n".join(table(last, query_place(last, region, least_probability, prior))))


def table(belief: "HybridBelief", placed: "Sequence[PlacedObject]") -> list[str]:
    """Table with a row per object, those likeliest to be here first."""
    classes = {own.object_id: own.likeliest_class for own in belief.objects}
    lines = [f"{'here':>8}  {'gone':>8}  {'object':>6}  {'x [m]':>8}  {'y [m]':>8}  name"]
    for item in placed:
        (x, y), number = item.pose[:2], item.object_id
        text = " ".join(filter(None, (item.name, classes.get(number))))
        lines.append(f"{item.here:8.4f}  {item.gone:8.4f}  {number:6d}  {x:8.2f}  {y:8.2f}  {text}")
    return lines
