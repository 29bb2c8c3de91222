"""A user's bag and a detector of another maker: are objects called what they are, out of the box?"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from semantic_slam.configuration import load_configuration, to_dict
from semantic_slam.shipped import configuration_file
from semantic_slam_lab.repetitions import repeat
from semantic_slam_lab.studies.own_detector.bags import LINES, Case, foreign_bag, room_bag
from semantic_slam_lab.studies.own_detector.baselines import RULES
from semantic_slam_lab.studies.own_detector.courses import CLASSES
from semantic_slam_lab.studies.own_detector.lessons import learned, teaching_run
from semantic_slam_lab.studies.own_detector.methods import DETECTOR_CONFIGURATION, METHODS, OURS, by_models
from semantic_slam_lab.studies.own_detector.pages import claims_of, tables_of
from semantic_slam_lab.studies.own_detector.scores import SURE, Named, carried, summary
from semantic_slam_lab.studies.result import write_result

NAME = "own_detector"
DATA = "data"
ROOMS, QUICK_ROOMS = 6, 1
DRAWS, QUICK_DRAWS = 4, 1
"""Bags of each room, on every line."""
VIEW_LINE, SIDE_LINE = "by view", "by side"
TAUGHT_LINES = (VIEW_LINE, SIDE_LINE)
"""Where other bags are learned from first: one of each other room; by side all that they share is how views repeat."""
TEACHING_DRAW = 1_000_000
"""Added to the seed: what is drawn in bags that only teach."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One bag; method -> its true objects that were detected."""

    case: Case
    objects: int  # true ones that were detected
    existing: int  # objects that are said to be there at the end
    others: int  # of these, the ones that are none of the true
    right: int  # true ones that are said to be there, by their names
    named: Mapping[str, Sequence[Named]]


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render, detect, drive, judge; returns the files written."""
    rooms, draws = (QUICK_ROOMS, QUICK_DRAWS) if quick else (ROOMS, DRAWS)
    bags = repeat(room_bag, [(number, out / DATA) for number in range(rooms)], jobs, "rooms")
    cases = [
        Case(line=line, room=room, draw=DRAWS * seed + draw, detector=_detector(line, room, draw, seed))
        for line in LINES
        for room in range(rooms)
        for draw in range(draws)
    ]
    with TemporaryDirectory() as folder:
        models = _lessons(Path(folder), bags, jobs, seed)
        given = [(case, bags[case.room], models.get((case.line, case.room), {})) for case in cases]
        judged = repeat(judge, given, jobs, "bags")
    return written(out, judged, quick, seed)


def _lessons(folder: Path, bags: Sequence[Path], jobs: int, seed: int) -> dict[tuple[str, int], Mapping[str, Path]]:
    """Line and tested room -> method -> file of models that one bag of each other room has taught."""
    rooms, draw = range(len(bags)), TEACHING_DRAW + seed
    taught = [(line, room) for line in TAUGHT_LINES for room in rooms]
    lessons = [
        (line, room, draw, _detector(line, room, draw, seed), bags[room], folder / "teaching") for line, room in taught
    ]
    folders = dict(zip(taught, repeat(teaching_run, lessons, jobs, "lessons"), strict=True))
    others = {
        (line, room): [folders[line, own] for own in rooms if own != room or len(bags) == 1] for line, room in taught
    }
    files = repeat(
        learned, [(others[key], folder / f"{key[0].replace(' ', '_')}_{key[1]}") for key in taught], jobs, "fits"
    )
    return dict(zip(taught, files, strict=True))


def _detector(line: str, room: int, draw: int, seed: int) -> int:
    """By view it is one detector in all bags, which may be learned from some for the others; else one for each."""
    return seed if line == VIEW_LINE else (seed * ROOMS + room) * DRAWS + draw


def judge(case: Case, room: Path, models: Mapping[str, Path]) -> Judged:
    """Every method on one bag, and rules on what ours associated; ``models`` are files by method, of other bags."""
    methods = METHODS | {name: partial(by_models, models=file) for name, file in models.items()}
    with TemporaryDirectory() as folder:
        foreign = foreign_bag(case, room, Path(folder))
        driven = {}
        for name, method in methods.items():
            (Path(folder) / name).mkdir()
            driven[name] = method(foreign, Path(folder) / name)
    drive = driven[OURS].drive
    is_carried = {
        true: carried([told.label for own in drive.views(true) for told in own], name)
        for true, name in drive.true_classes.items()
    }
    courses = {name: own.drive.believed(own.names) for name, own in driven.items()}
    courses |= {name: drive.by_views(rule) for name, rule in RULES.items()}
    existence, last = drive.existence, {own.object_id: own for own in courses[OURS]}
    right = [existence[true] > 0.5 and own.is_right for true, own in last.items()]
    return Judged(
        case=case,
        objects=len(last),
        existing=drive.num_existing,
        others=drive.num_others,
        right=sum(right),
        named={
            name: [Named(course=one, is_carried=is_carried[one.object_id]) for one in own]
            for name, own in courses.items()
        },
    )


def written(out: Path, judged: Sequence[Judged], quick: bool, seed: int) -> list[Path]:
    """The result and its page."""
    from semantic_slam.pipeline.provenance import revision

    lines = {line: line_of([own for own in judged if own.case.line == line]) for line in LINES}
    result = {
        "study": NAME,
        "seed": seed,
        "config": {
            "detector": to_dict(load_configuration(configuration_file(DETECTOR_CONFIGURATION))),
            "lines": {line: asdict(faults) for line, faults in LINES.items()},
        },
        "revision": revision(),
        "quick": quick,
        "methods": lines[VIEW_LINE]["methods"],
        "lines": lines,
        "bags": [bag_row(own) for own in judged],
    }
    return write_result(out, result, claims_of(result), tables_of(result))


def line_of(judged: Sequence[Judged]) -> dict[str, Any]:
    """What came of all bags of one line."""
    named = [own for bag in judged for own in bag.named[OURS]]
    sure = [own.course.true_probability[-1] >= SURE for own in named if own.is_carried]
    return {
        "bags": len(judged),
        "objects": sum(bag.objects for bag in judged),
        "right": sum(bag.right for bag in judged),
        "bags_all_right": sum(bag.right == bag.objects for bag in judged),
        "others": sum(bag.others for bag in judged),
        "bags_with_others": sum(bag.others > 0 for bag in judged),
        "carried": len(sure),
        "carried_sure": sum(map(bool, sure)),
        "methods": {name: summary([own for bag in judged for own in bag.named[name]]) for name in judged[0].named},
    }


def bag_row(bag: Judged) -> dict[str, Any]:
    """One bag by itself."""
    own = bag.named[OURS]
    return {
        **asdict(bag.case),
        "objects": bag.objects,
        "existing": bag.existing,
        "others": bag.others,
        "right": bag.right,
        "true_class_probabilities": {one.course.object_id: float(one.course.true_probability[-1]) for one in own},
        "likeliest": {one.course.object_id: CLASSES[int(one.course.probabilities[-1].argmax())] for one in own},
        "nll": {name: summary(rows)["nll"] for name, rows in bag.named.items()},
    }
