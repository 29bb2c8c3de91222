"""``python -m semantic_slam_lab.kills``: kills nodes of a demo, and compares its beliefs with an undisturbed one's.

Each trial is a demo of its own. ``--nodes``: each node is killed at every tenth keyframe, in one trial or, where it is
still down from the last time, in several.
``--all N``: everything at once, the demo, too, at random instants, N times; each time the demo goes on with --resume.
``--launch``: through ``ros2 launch semantic_slam demo.launch.py`` in place of the demo, where ROS 2 is whole.
"""

import argparse
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import SemanticSlamError
from semantic_slam.pipeline.provenance import revision
from semantic_slam_lab.kills.claims import claim_of_everything, claim_of_nodes, table_of
from semantic_slam_lab.kills.trials import Trial, grid
from semantic_slam_lab.studies.result import write_result

NODES = ("backend_0", "backend_1", "classifier", "hypothesis_manager", "bag_recorder", "bag_player")


def command() -> None:
    """Entry point; raises SemanticSlamError when a claim does not hold."""
    parser = CommandParser("python -m semantic_slam_lab.kills", description=__doc__)
    parser.add_argument("--bag", type=Path, default=Path("bags/aliased_room"))
    parser.add_argument("--config", type=Path, default=Path("config/default.yaml"))
    parser.add_argument("--out", type=Path, default=Path("out/kills"))
    parser.add_argument("--nodes", nargs="*", default=list(NODES), help="nodes to be killed (default: each)")
    parser.add_argument("--all", type=int, default=20, help="how often everything is killed (default: %(default)s)")
    parser.add_argument("--launch", action="store_true", help="through ros2 launch in place of the demo")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    trials = []
    for trial in run(arguments):
        print(trial.line, flush=True)
        trials.append(trial)
    write(arguments, trials)


def run(arguments: argparse.Namespace) -> Iterator[Trial]:
    """All trials, one after the other. Raises SemanticSlamError."""
    made = grid(arguments.bag, arguments.config, arguments.out, through_launch=arguments.launch)
    yield from chain.from_iterable(made.one_node(name) for name in arguments.nodes)
    yield from made.everything(arguments.all, arguments.seed)


def write(arguments: argparse.Namespace, trials: Sequence[Trial]) -> None:
    """Write the result and its page. Raises SemanticSlamError where a claim does not hold."""
    made = claim_of_nodes(trials), claim_of_everything(trials, arguments.all)
    claims = [claim for claim in made if claim is not None]
    result = {
        "study": "kills",
        "quick": False,
        "seed": arguments.seed,
        "revision": revision(),
        "through": "ros2 launch" if arguments.launch else "demo",
        "bag": str(arguments.bag),
        "config": str(arguments.config),
        "trials": [trial.kept for trial in trials],
    }
    for path in write_result(arguments.out, result, claims, [table_of(trials)]):
        print(path)
    for claim in claims:
        if not claim.holds:
            raise SemanticSlamError(f"{claim.text}: {claim.measured}; see the logs in {arguments.out}")


run_main(command)
