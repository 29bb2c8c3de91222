"""``bench --out FILE [--quick]``: ratios against peers, each measured in one run, on one core."""

import argparse
import dataclasses
import os
from pathlib import Path
from typing import Any

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.outputs import add_overwrite, claimed_file

SCHEMA_VERSION = 1


def parse(words: list[str] | None = None) -> argparse.Namespace:
    """Arguments of the command line; raises InputError."""
    parser = CommandParser(description="Measure our methods against their peers in the same run.")
    parser.add_argument("--out", type=Path, default=Path("out/bench.json"), help="file to write (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--seed", type=int, default=0, help="seed of every random draw (default: %(default)s)")
    add_overwrite(parser)
    return parser.parse_args(words)


def measure(quick: bool, seed: int) -> list[Any]:
    """All rows, one benchmark after the other."""
    import torch
    from tqdm import tqdm

    from semantic_slam_lab.benchmarks import (
        classification,
        detector_share,
        engine_growth,
        hybrid_smoother,
        keyframe_floor,
        latent_drive,
        latent_update,
        mc_dropout,
        option_costs,
        spatial_keyframe,
        two_backends,
        weights_accuracy,
        weights_time,
    )

    torch.set_num_threads(1)
    benchmarks = (
        classification.growth,
        classification.against_literal,
        classification.window_loss,
        mc_dropout.passes,
        weights_accuracy.accuracy,
        weights_time.weights,
        keyframe_floor.floor,
        spatial_keyframe.spatial,
        detector_share.share,
        option_costs.costs,
        hybrid_smoother.hybrid,
        two_backends.two_backends,
        engine_growth.growth,
        latent_update.updates,
        latent_drive.drive,
    )
    return [row for benchmark in tqdm(benchmarks, desc="benchmarks") for row in benchmark(quick, seed)]


def write(path: Path, rows: list[Any], quick: bool, seed: int) -> None:
    """``bench.json``: schema_version, quick, seed, revision, machine, config, results."""
    from semantic_slam.configuration import Configuration, to_dict
    from semantic_slam.pipeline.provenance import machine, revision
    from semantic_slam.report.plain_json import to_text

    content = {
        "schema_version": SCHEMA_VERSION,
        "quick": quick,
        "seed": seed,
        "revision": revision(),
        "machine": machine(),
        "config": to_dict(Configuration()),
        "results": [dataclasses.asdict(row) for row in rows],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(to_text(content), encoding="utf-8")


def command() -> None:
    """Measure, write, and print a table."""
    arguments = parse()
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"  # before numpy: one core, so that ratios do not depend on how many there are
    with claimed_file(arguments.out, (), arguments.overwrite) as out:
        rows = measure(arguments.quick, arguments.seed)
        write(out, rows, arguments.quick, arguments.seed)
    for row in rows:
        print(f"{row.name:42} {row.ratio:10.2f}   ours {row.ours:.4g} {row.unit}, peer {row.peer:.4g}")
    print(arguments.out)


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
