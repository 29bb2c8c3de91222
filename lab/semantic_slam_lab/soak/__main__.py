"""``python -m semantic_slam_lab.soak``: runs the engine for a day's keyframes, and says what each costs and leaves."""

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam_lab.soak.comparison import compared
from semantic_slam_lab.soak.measures import EVERY, soaked
from semantic_slam_lab.soak.restarts import AT, restarted
from semantic_slam_lab.soak.robots import ROBOTS, map_of, robot


def main() -> None:
    """Entry point."""
    run_main(_command)


def _command() -> None:
    parser = CommandParser("semantic_slam_lab.soak", description=__doc__)
    parser.add_argument("--robot", choices=list(ROBOTS), default="given")
    parser.add_argument("--keyframes", type=int, default=2000)
    parser.add_argument("--horizon", type=int, default=0, help="history.horizon_keyframes; 0: off")
    parser.add_argument("--against-full", action="store_true", help="hold the summary against the whole graph")
    parser.add_argument("--restarts", action="store_true", help="what the journal takes, and a restart from it costs")
    parser.add_argument("--whole-journal", action="store_true", help="with --restarts: without snapshots")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    configuration, prior = robot(arguments.robot, arguments.horizon), map_of(arguments.robot)
    if arguments.against_full:
        found = compared(configuration, arguments.keyframes, arguments.seed, EVERY, prior)
        for number, row in enumerate(found, start=1):
            print(
                f"{EVERY * number:6d} keyframes: shift {row.shift:.3f} sigma, sigmas {row.least_ratio:.4f}"
                f" to {row.largest_ratio:.4f} of the whole graph's"
            )
        return
    rows = soaked(configuration, prior, arguments.keyframes, arguments.seed)
    if arguments.restarts:
        rows = restarted(configuration, prior, AT, arguments.seed, snapshots=not arguments.whole_journal)
    for number, measured in enumerate(rows):
        if number == 0:
            print("  ".join(f"{name:>13}" for name in measured))
        print("  ".join(f"{value:13.6g}" for value in measured.values()), flush=True)


if __name__ == "__main__":
    main()
