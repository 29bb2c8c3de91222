"""``run_study NAME --out DIR``: an experiment, its result.json and its page."""

import importlib
from argparse import Namespace
from pathlib import Path
from typing import Any

from semantic_slam.cli.exit_codes import CommandParser, program, run_main
from semantic_slam.cli.turntable_views import add_photographs, check_photographs
from semantic_slam.errors import InputError
from semantic_slam.outputs import add_overwrite, claimed_folder

STUDIES = {
    "aliased_scenes": "semantic_slam_lab.studies.aliased_room.scenes",
    "aliased_room": "semantic_slam_lab.studies.aliased_room.study",
    "avd_bigbird": "semantic_slam_lab.studies.avd_bigbird.study",
    "carried_robot": "semantic_slam_lab.studies.carried_robot.study",
    "ch3_localization": "semantic_slam_lab.studies.ch3.localization",
    "ch3_model_uncertainty": "semantic_slam_lab.studies.ch3.model_uncertainty",
    "ch4_example": "semantic_slam_lab.studies.ch4.example",
    "ch4_statistics": "semantic_slam_lab.studies.ch4.statistics",
    "ch5_grounding": "semantic_slam_lab.studies.ch5.grounding",
    "ch5_latent_space": "semantic_slam_lab.studies.ch5.latent_space",
    "ch5_likelihood": "semantic_slam_lab.studies.ch5.likelihood",
    "ch5_localization": "semantic_slam_lab.studies.ch5.localization",
    "ch5_sensitivity": "semantic_slam_lab.studies.ch5.sensitivity",
    "desks": "semantic_slam_lab.studies.desks.study",
    "drawn_worlds": "semantic_slam_lab.studies.drawn_worlds.study",
    "embeddings": "semantic_slam_lab.studies.embeddings.study",
    "faulty_rooms": "semantic_slam_lab.studies.faulty_rooms.study",
    "latent_slam": "semantic_slam_lab.studies.latent_slam.study",
    "lost_robot": "semantic_slam_lab.studies.lost_robot.study",
    "novelty": "semantic_slam_lab.studies.novelty.study",
    "own_detector": "semantic_slam_lab.studies.own_detector.study",
    "real_cabinet": "semantic_slam_lab.studies.real_cabinet.study",
    "real_drives": "semantic_slam_lab.studies.real_drives.study",
    "real_in_space": "semantic_slam_lab.studies.real_in_space.study",
    "real_turntables": "semantic_slam_lab.studies.real_turntables.study",
    "real_kitchen": "semantic_slam_lab.studies.real_kitchen.study",
    "rendered_localization": "semantic_slam_lab.studies.rendered.localization",
    "rendered_model_uncertainty": "semantic_slam_lab.studies.rendered.model_uncertainty",
    "replay_scaling": "semantic_slam_lab.studies.replay_scaling.study",
    "second_session": "semantic_slam_lab.studies.second_session.study",
    "tables": "semantic_slam_lab.studies.tables.study",
    "victoria_park": "semantic_slam_lab.studies.victoria_park.study",
}
"""Name -> module with ``run(out, quick, jobs, seed) -> files written``."""
OPTIONS = {
    "avd_bigbird": ("avd", "bigbird"),
    "embeddings": ("data",),
    "lost_robot": ("data", "drives"),
    "novelty": ("data", "pattern", "mask_pattern"),
    "real_cabinet": ("data",),
    "real_drives": ("data", "drives", "methods", "everything"),
    "real_in_space": ("data",),
    "real_turntables": ("data", "pattern", "mask_pattern"),
    "real_kitchen": ("data",),
}
"""Study -> what else its ``run`` takes by keyword, as the command line has it; None or False where it has not."""

RENDERED = "data"
"""Folder of a study's output that a later run of it may use."""


def parse(words: list[str] | None = None) -> Namespace:
    """Arguments of the command line; raises InputError."""
    parser = CommandParser(description="Run an experiment and set its claims beside what it measured.")
    parser.add_argument("name", nargs="?", metavar="NAME", help="study (--list names them)")
    parser.add_argument("--list", action="store_true", help="print the names of the studies, one per line")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for result.json and result.html")
    parser.add_argument("--quick", action="store_true", help="a small part of it, in minutes")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default: 1)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of every random draw (default: 0)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler that gets the work (default: none)")
    add_overwrite(parser)
    for name in ("avd", "bigbird"):
        text = f"avd_bigbird: folder in {name.upper()}'s layout (default: simulated)"
        parser.add_argument(f"--{name}", type=Path, metavar="DIR", help=text)
    text = "studies on real data: folder of the data sets (default: SEMANTIC_SLAM_DATA)"
    parser.add_argument("--data", type=Path, metavar="DIR", help=text)
    add_photographs(parser, "real_turntables, novelty: in --data, or its folder coil100; default: COIL-100's names")
    for name, what in (("drives", "such as mrclam_d6/1 or dlr (default: all)"), ("methods", "besides ours")):
        parser.add_argument(f"--{name}", nargs="+", metavar="NAME", help=f"real_drives: {name}, {what}")
    text = "real_drives: ablations and calibrated baselines, too, as far as there are any"
    parser.add_argument("--all", action="store_true", dest="everything", help=text)
    return parser.parse_args(words)


def command() -> None:
    """Run the study that the command line names; raises InputError."""
    arguments = parse()
    if arguments.list:
        print("\n".join(STUDIES))
        return
    if arguments.name is None:
        raise InputError(f"{program()}: name a study; there are: {', '.join(STUDIES)}")
    if arguments.name not in STUDIES:
        raise InputError(f"{program()}: no study {arguments.name!r}; there are: {', '.join(STUDIES)}")
    if arguments.out is None:
        raise InputError(f"{program()}: --out is missing; name a folder for the results")
    if arguments.jobs < 1 or arguments.seed < 0:
        raise InputError(f"{program()}: --jobs must be at least 1 and --seed at least 0; correct the number")
    options = _options(arguments)
    check_photographs(arguments, [arguments.data or Path()])
    from semantic_slam_lab.repetitions import scheduler

    study = importlib.import_module(STUDIES[arguments.name])
    inputs = [value for value in options.values() if isinstance(value, Path)]
    with claimed_folder(arguments.out, inputs, arguments.overwrite) as out, scheduler(arguments.scheduler):
        link_rendered(arguments.out, out)
        paths = study.run(out, quick=arguments.quick, jobs=arguments.jobs, seed=arguments.seed, **options)
    for path in paths:
        print(arguments.out / path.relative_to(out))


def _options(arguments: Namespace) -> dict[str, Any]:
    """What the study takes besides what all of them do; raises InputError for an option that is another study's."""
    own = OPTIONS.get(arguments.name, ())
    given = {name: getattr(arguments, name) for names in OPTIONS.values() for name in names}
    others = [name for name, value in given.items() if value and name not in own]
    if others:
        option = "all" if others[0] == "everything" else others[0].replace("_", "-")
        raise InputError(f"{program()}: {arguments.name} has no option --{option}; leave it out")
    return {name: given[name] for name in own}


def link_rendered(old: Path, new: Path) -> None:
    """What a study has rendered before is used again where it lies; it is added to, never replaced."""
    if new != old and (old / RENDERED).is_dir():
        (new / RENDERED).symlink_to((old / RENDERED).resolve(), target_is_directory=True)


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
