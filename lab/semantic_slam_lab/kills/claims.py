"""What the demos whose nodes are killed are to show, and what was seen."""

from collections.abc import Sequence

from semantic_slam_lab.kills.comparison import TOLERANCE
from semantic_slam_lab.kills.trials import EVERY, EVERYTHING, Trial
from semantic_slam_lab.studies.result import Claim, Table

SOURCE = "this project"
COLUMNS = ("killed", "times", "at keyframes", "beliefs", "of", "largest difference")


def claim_of_nodes(trials: Sequence[Trial]) -> Claim | None:
    """That demos go on whichever node is killed, each of them at least once; None where there is no such demo."""
    own = [trial for trial in trials if trial.killed != EVERYTHING]
    names = list(dict.fromkeys(trial.killed for trial in own))
    text = f"kill -9 of {', '.join(names)}, each at every {EVERY}th keyframe: the same beliefs"
    return _claim(text, own, all(trial.at for trial in own))


def claim_of_everything(trials: Sequence[Trial], asked: int) -> Claim | None:
    """That demos go on when everything was killed at once, ``asked`` times in all; None where there is no such demo."""
    own = [trial for trial in trials if trial.killed == EVERYTHING]
    text = "kill -9 of everything at once, the demo, too, at random instants: the same beliefs"
    return _claim(text, own, _num_kills(own) == asked)


def _claim(text: str, trials: Sequence[Trial], were_killed: bool) -> Claim | None:
    if not trials:
        return None
    worst = max(trial.largest_difference for trial in trials)
    measured = f"{_num_kills(trials)} kills in {len(trials)} demos, largest difference of any number {worst:.2g}"
    return Claim(text, SOURCE, "", measured, were_killed and worst <= TOLERANCE)


def _num_kills(trials: Sequence[Trial]) -> int:
    return sum(len(trial.at) for trial in trials)


def table_of(trials: Sequence[Trial]) -> Table:
    """A row for each demo."""
    return Table("Demos", COLUMNS, tuple(_row(trial) for trial in trials))


def _row(trial: Trial) -> tuple[str, ...]:
    numbers = ", ".join(map(str, trial.at))
    return (
        trial.killed,
        str(len(trial.at)),
        numbers,
        str(trial.beliefs),
        str(trial.of),
        f"{trial.largest_difference:.2g}",
    )
