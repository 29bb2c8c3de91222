"""``python -m semantic_slam_lab.fuzz --live --messages 2000``: forged messages to every topic of a demo that runs.

A demo is left in peace, and another one is sent messages that nobody of it sends, and asked what cannot be answered.
No node may die, the beliefs are to be the same, and each node is to count whatever it was sent and to refuse what it
was asked. The last line is ``N messages, M findings``.
"""

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from semantic_slam_lab.fuzz.asker import Asker
from semantic_slam_lab.fuzz.forger import Forger, forger
from semantic_slam_lab.fuzz.results import Forged, write_forged
from semantic_slam_lab.kills.comparison import TOLERANCE, largest_difference
from semantic_slam_lab.kills.demo import Demo
from semantic_slam_lab.kills.trials import run_killing

ATTACKED = 0.5
"""Share of the keyframes; the rest is left in peace, for what was counted has to be told before the nodes end."""
ASKED = 0.15
"""Share of what is sent that asks a service."""
CHECK_S = 0.02


def run_live(arguments: argparse.Namespace) -> int:
    """Both demos: the exit code."""
    with TemporaryDirectory(prefix="fuzz_") as folder:
        undisturbed, forged = (
            Demo(arguments.bag, arguments.config, Path(folder) / name) for name in ("undisturbed", "forged")
        )
        run_killing(undisturbed, [])
        with forger(arguments.bag, int(forged.domain_id)) as forging:
            asking = Asker(forging.node, Path(folder))
            attacked = round(ATTACKED * len(undisturbed.beliefs()))
            deaths = attack(forging, asking, forged, arguments.messages, attacked, arguments.seed)
        difference = largest_difference(forged.beliefs(), undisturbed.beliefs(), besides="dropped")
        findings = [*deaths, *uncounted(forging), *asking.findings()]
        if difference > TOLERANCE:
            findings.append(f"beliefs differ by {difference:.3g}")
    found = Forged(
        num_messages=forging.num_sent + asking.num_asked,
        counted=forging.owed,
        refused=asking.refused(),
        largest_difference=difference,
        findings=findings,
    )
    if arguments.out is not None:
        write_forged(arguments.out, found, arguments.seed)
    for line in found.lines:
        print(line)
    return int(bool(findings))


def attack(forging: Forger, asking: Asker, demo: Demo, count: int, num_keyframes: int, seed: int) -> list[str]:
    """Run a demo to its end, forging and asking, evenly over so many keyframes; a line for each node that died."""
    chance, pids, deaths = np.random.default_rng(seed), dict[str, int](), list[str]()
    with demo.running():
        while demo.is_running:
            for name, pid in demo.nodes().items():
                if pids.setdefault(name, pid) != pid:
                    deaths.append(f"{name} died")
                    pids[name] = pid
            due = min(count, int(count * (forging.keyframe + 1) / num_keyframes))
            while forging.num_sent + asking.num_asked < due and demo.is_running:
                disturb(forging, asking, chance)
            time.sleep(CHECK_S)
        demo.end()
    return deaths


def disturb(forging: Forger, asking: Asker, chance: np.random.Generator) -> None:
    """One message, or one question."""
    if chance.random() < ASKED:
        asking.ask(chance)
    else:
        forging.send(chance)


def uncounted(forging: Forger) -> Iterator[str]:
    """A line for each node and topic that has counted less than it was sent."""
    owed = Counter[tuple[str, str]]()
    for (node, topic, _), number in forging.owed.items():
        owed[node, topic] += number
    for (node, topic), number in sorted(owed.items()):
        counted = forging.counted_of(node, topic)
        if (total := sum(counted.values())) < number:
            told = ", ".join(f"{count} x {reason}" for reason, count in sorted(counted.items()))
            yield f"{node} counts {total} of {number} forgeries of {topic}: {told}"
