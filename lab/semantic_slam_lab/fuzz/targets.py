"""What is fed, and to which readers: bags, configurations, maps, messages and models."""

import json
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from itertools import chain
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
import yaml
from numpy.random import Generator

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import Configuration, from_dict, load_configuration
from semantic_slam.datasets.space.drive import write_spatial_drive
from semantic_slam.datasets.tum_rgbd.folder import read_tum_folder
from semantic_slam.datasets.tum_rgbd.tum_rgbd_import import of_camera, read_drive
from semantic_slam.datasets.user_bag.label_map import read_label_map
from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.run_id import run_id_of
from semantic_slam.inference.world.map_prior import parse_map_prior, read_map_prior
from semantic_slam.latent.store import read_latent_model
from semantic_slam.maps.as_prior import map_prior_of, saved_map_of_prior
from semantic_slam.maps.comparison import Comparison
from semantic_slam.maps.differences import difference
from semantic_slam.maps.map_file import FORMAT as MAP_FORMAT
from semantic_slam.maps.map_file import packed, read_map, with_id, write_map
from semantic_slam.messages.codec import BY_TYPE_NAME, decode, from_message
from semantic_slam.messages.typestore import serialize
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.rounds.work_order import WorkOrder
from semantic_slam.shipped import CONFIGURATIONS
from semantic_slam.viewpoint.store import read_model
from semantic_slam_lab.fuzz import small_drive
from semantic_slam_lab.fuzz.answers import answers
from semantic_slam_lab.fuzz.crowds import crowds
from semantic_slam_lab.fuzz.harness import Case, Target
from semantic_slam_lab.fuzz.mutation import (
    change_message,
    damaged,
    with_extreme_numbers,
    with_strange_values,
)
from semantic_slam_lab.fuzz.pictures import pictures
from semantic_slam_lab.fuzz.protocol import spoken

OPEN = {**small_drive.PLAIN, "association": "open"}
STRANGE_NUMBERS = (-1.0, 0.0, 1.0, 1e-300, 1e9)
WEIGHTS = CONFIGURATIONS.parent / "weights"
MODELS: dict[str, Callable[[Path], Any]] = {
    "viewpoint_models.safetensors": read_model,
    "latent_model.safetensors": read_latent_model,
}


def configurations(folder: Path) -> Case:
    """Files damaged as texts, or with strange values; what is accepted has to begin a run."""
    texts = [path.read_bytes() for path in sorted(CONFIGURATIONS.glob("*.yaml")) if "labels" not in path.name]
    path = folder / "configuration.yaml"

    def case(chance: Generator) -> None:
        text, what = texts[chance.integers(len(texts))], chance.random()
        if what < 0.3:
            path.write_bytes(damaged(text, chance))
        else:
            change = with_strange_values if what < 0.5 else with_extreme_numbers
            path.write_text(yaml.safe_dump(change(yaml.safe_load(text), chance)), encoding="utf-8")
        _two_keyframes(load_configuration(path), small_drive.map_prior().to_json())

    return case


def labels(folder: Path) -> Case:
    """Label files."""
    text, path = b"person: null\nchair: chair\n'56': chair\n", folder / "labels.yaml"

    def case(chance: Generator) -> None:
        path.write_bytes(damaged(text, chance))
        read_label_map(path)

    return case


def maps(folder: Path) -> Case:
    """Maps damaged as texts, or with strange values; what is accepted has to begin a run."""
    text, path = small_drive.map_prior().to_json(), folder / "objects.json"
    configurations = [from_dict(small_drive.PLAIN), from_dict(OPEN)]

    def case(chance: Generator) -> None:
        what = chance.random()
        if what < 0.3:
            path.write_bytes(damaged(text.encode(), chance))
        else:
            change = with_strange_values if what < 0.5 else with_extreme_numbers
            path.write_text(json.dumps(change(json.loads(text), chance)), encoding="utf-8")
        read_map_prior(path)
        _two_keyframes(configurations[chance.integers(2)], path.read_text(encoding="utf-8"))

    return case


def map_files(folder: Path) -> Case:
    """Files of maps that are damaged, or whole with strange numbers; what is accepted has to begin a run."""
    whole, path = with_id(saved_map_of_prior(small_drive.map_prior())), folder / "room.map"
    configurations = [from_dict(small_drive.PLAIN), from_dict(OPEN)]
    write_map(path, whole)
    data = path.read_bytes()

    def case(chance: Generator) -> None:
        if chance.random() < 0.4:
            path.write_bytes(damaged(data, chance))
        else:
            part = ("objects", "hypotheses")[chance.integers(2)]
            before = getattr(whole, part)
            names = sorted(name for name, own in vars(before).items() if isinstance(own, np.ndarray) and own.size)
            name = names[chance.integers(len(names))]
            changed = getattr(before, name).copy()
            changed.flat[chance.integers(changed.size)] = chance.choice(STRANGE_NUMBERS)
            strange = replace(whole, **{part: replace(before, **{name: changed})})
            MAP_FORMAT.write(path, *packed(with_id(strange)))
        known = read_map(path)
        _two_keyframes(configurations[chance.integers(2)], map_prior_of(known).to_json())
        difference(Comparison.of(whole, known, same_frame=bool(chance.integers(2))))

    return case


def bags(folder: Path) -> Case:
    """Bags with damaged storage or metadata: reader and every message in them."""
    whole = small_drive.write(folder / "whole", small_drive.items(), small_drive.map_prior())
    contents = {path.name: path.read_bytes() for path in whole.iterdir()}
    spoiled = folder / "spoiled"

    def case(chance: Generator) -> None:
        rmtree(spoiled, ignore_errors=True)
        spoiled.mkdir()
        at_fault = sorted(contents)[chance.integers(len(contents))] if chance.random() < 0.4 else "whole.mcap"
        for name, data in contents.items():
            (spoiled / name).write_bytes(damaged(data, chance) if name == at_fault else data)
        with BagReader(spoiled) as reader:
            for message in reader.messages():
                try:
                    reader.decode(message.cdr, message.type_name)
                except InputError:
                    continue

    return case


def drives(folder: Path) -> Case:
    """Whole runs on messages that are strange, or damaged as bytes where the bag holds them."""
    settings = [from_dict(small_drive.PLAIN), from_dict(OPEN), load_configuration(CONFIGURATIONS / "uncalibrated.yaml")]

    def case(chance: Generator) -> None:
        for name in ("input", "belief"):
            rmtree(folder / name, ignore_errors=True)
        messages = deepcopy(small_drive.items())
        for _ in range(1 + chance.integers(3)):
            change_message(messages[chance.integers(len(messages))].message, chance)
        try:
            bag = small_drive.write(folder / "input", messages, small_drive.map_prior())
        except Exception:  # no such message can be sent
            return
        run_bag(bag, folder / "belief", settings[chance.integers(len(settings))])
        read_record(folder / "belief")

    return case


def camera_folders(folder: Path) -> Case:
    """Folders of a hand-held camera with a file that is damaged."""
    poses = "".join(f"{1.0 + 0.1 * n} {0.1 * n} 0 1.4 -0.5 0.5 -0.5 0.5\n" for n in range(5))
    texts = {
        "groundtruth.txt": poses,
        "odometry.txt": poses,
        "camera.txt": "500 500 320 240 640 480\n",
        "imu.txt": "".join(f"{1.0 + 0.1 * n} 0 -9.81 0 0 0 0\n" for n in range(5)),
        "rgb.txt": "1.0 rgb/0.png\n1.1 rgb/1.png\n",
        "detections.csv": "stamp_s,label,score,x_min,y_min,x_max,y_max\n1.0,cup,0.5,1,2,3,4\n1.2,cup,0.5,2,0,3,4\n",
        "objects.csv": "object_id,x,y,z\n0,1,2,3\n",
    }
    source = folder / "source"
    source.mkdir()

    def case(chance: Generator) -> None:
        names = sorted(texts)
        hurt = names[chance.integers(len(names))]
        for name in names:
            text = texts[name].encode()
            (source / name).write_bytes(damaged(text, chance) if name == hurt else text)
        rmtree(folder / "bag", ignore_errors=True)
        found = read_tum_folder(source)
        drive = read_drive(found, 0.03, 0)
        write_spatial_drive(drive, folder / "bag", "fuzz", others=of_camera(found, drive))

    return case


def messages(folder: Path) -> Case:
    """CDR of our own types, damaged as bytes or strange in one value."""
    samples = _samples()

    def case(chance: Generator) -> None:
        message = deepcopy(samples[chance.integers(len(samples))])
        type_name = message.__msgtype__
        if chance.random() < 0.6:
            decode(damaged(serialize(message), chance), type_name)
            return
        change_message(message, chance)
        try:
            data = serialize(message)
        except Exception:  # no such message can be sent
            return
        decode(data, type_name)

    return case


def rounds(folder: Path) -> Case:
    """A backend's work with one message of the run strange, repeated, or of another run."""
    run, *rest = spoken()

    def case(chance: Generator) -> None:
        order = WorkOrder(lambda: Backend(0))
        spoiled, at = deepcopy([run, *rest]), int(chance.integers(1 + len(rest)))
        what = chance.random()
        if what < 0.6:
            change_message(spoiled[at], chance)
        extra = [deepcopy(spoiled[at])] if what > 0.5 else []
        if extra and chance.random() < 0.5:
            change_message(extra[0], chance)
        if chance.random() < 0.5:  # whoever sends it may know how ids are made
            _name_anew(spoiled[0])
        for message in chain(spoiled[: at + 1], extra, spoiled[at + 1 :]):
            try:
                data = serialize(message)
            except Exception:  # no such message can be sent
                return
            order.take(data, message.__msgtype__)

    return case


def models(folder: Path) -> Case:
    """Model files, their arrays and descriptions damaged."""
    contents = {name: (WEIGHTS / name).read_bytes() for name in MODELS}

    def case(chance: Generator) -> None:
        name = sorted(contents)[chance.integers(len(contents))]
        data = contents[name]
        head = 8 + int.from_bytes(data[:8], "little")
        path = folder / name
        split = head if chance.random() < 0.7 else len(data)
        path.write_bytes(damaged(data[:split], chance) + data[split:])
        MODELS[name](path)

    return case


TARGETS: dict[str, Target] = {
    target.__name__: target
    for target in (
        configurations,
        labels,
        maps,
        map_files,
        bags,
        drives,
        camera_folders,
        messages,
        rounds,
        models,
        pictures,
        answers,
        crowds,
    )
}


def _two_keyframes(configuration: Configuration, prior: str) -> None:
    """A run's beginning: two detections after each of two motions."""
    engine = Engine(configuration, parse_map_prior(prior, "objects.json"))
    for k in range(2):
        ahead = small_drive.OBJECTS - [small_drive.SPEED_M * (k + 1), 0.0]
        seen = [Detection.at(float(x), float(y), track_id=str(n)) for n, (x, y) in enumerate(ahead)]
        engine.process(Keyframe.planar(k, detections=seen, motion=(small_drive.SPEED_M, 0.0, 0.0)))


def _samples() -> list[Any]:
    """A message of each of our types that a small run has."""
    found = {item.message.__msgtype__: item.message for item in small_drive.items()}
    for message in spoken():
        found[message.__msgtype__] = message
    return [message for name, message in found.items() if name in BY_TYPE_NAME]


def _name_anew(run: Any) -> None:
    """Give an announcement the id of its contents."""
    value = from_message(run)
    told = (value.configuration, value.map_prior, value.initial_pose, value.initial_covariance, value.class_names)
    run.run_id = run_id_of(*told)
