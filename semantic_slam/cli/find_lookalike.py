"""``find_lookalike BELIEF CROP``: find the mapped object that looks like an image crop."""

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError

if TYPE_CHECKING:
    from semantic_slam.answers.region import Region
    from semantic_slam.inference.belief import HybridBelief
    from semantic_slam.inference.lookalike import Lookalikes


def parse(words: list[str] | None = None) -> Namespace:
    """Parse the command line; raises InputError."""
    parser = CommandParser(
        description="Rank the objects of a map by how probably a crop shows them, from whatever direction. The map is"
        " the last belief of a run with semantic_model.kind: latent.",
    )
    parser.add_argument("belief", type=Path, metavar="REPORT_OR_BELIEF_BAG", help="folder of a report, or belief bag")
    parser.add_argument("crop", type=Path, metavar="CROP", help="picture of the object, png or jpeg")
    add_view(parser)
    return parser.parse_args(words)


def add_view(parser: CommandParser) -> None:
    """Add the flags that describe the image: box and elevation."""
    parser.add_argument(
        "--box", type=float, nargs=4, metavar=("X0", "Y0", "X1", "Y1"), help="pixels of the object (default: all)"
    )
    parser.add_argument(
        "--elevation-deg", type=float, default=14.3, help="how far the camera looked down (default: %(default)s)"
    )


def command() -> None:
    """Parse, query, print; raises InputError."""
    ask(parse())


def ask(arguments: Namespace, region: "Region | None" = None, least_probability: float = 0.0) -> None:
    """Rank and print objects by similarity to the crop, filtered by region and probability; raises InputError."""
    import numpy as np

    from semantic_slam.answers.region import inside
    from semantic_slam.configuration import from_dict
    from semantic_slam.evaluation.belief_bag import read_record
    from semantic_slam.evaluation.record import json_object
    from semantic_slam.pipeline.lookalike_query import LookalikeQuery, picture

    record = read_record(arguments.belief)
    settings = from_dict(json_object(record.run.configuration), str(arguments.belief)).semantic_model
    try:
        image = picture(arguments.crop.read_bytes(), str(arguments.crop))
    except OSError as fault:
        raise InputError(f"{arguments.crop}: {fault.strerror}; name an existing picture") from None
    box = np.array(arguments.box) if arguments.box else None
    last = record.beliefs[-1]
    found = LookalikeQuery(settings).ask(last, image, box, float(np.deg2rad(arguments.elevation_deg)))
    if region is not None:
        shown = found.probabilities * inside(last, region)
        found = replace(found, probabilities=shown, unknown=1.0 - float(shown.sum()))
    print("\n".join(table(last, found, least_probability)))


def table(belief: "HybridBelief", found: "Lookalikes", least_probability: float = 0.0) -> list[str]:
    """Table with a row per object, the likeliest first, and one for none of them."""
    import numpy as np

    lines = [f"{'probability':>11}  {'object':>6}  {'seen from':>9}  name"]
    for row in found.ranking():
        if found.probabilities[row] < least_probability:
            break
        degrees = f"{np.rad2deg(found.azimuth_rad[row]):.0f} deg"
        number, name = int(belief.object_ids[row]), belief.object_names[row]
        lines.append(f"{found.probabilities[row]:11.4f}  {number:6d}  {degrees:>9}  {name}")
    return [*lines, f"{found.unknown:11.4f}  {'-':>6}  {'':>9}  none of them"]


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
