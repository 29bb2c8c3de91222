"""Recreates the keyframes of a recorded run from the measurements and the odometry in its belief bag."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.configuration import Configuration
from semantic_slam.errors import MessageError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.pipeline.assembly.keyframe_assembler import KeyframeAssembler
from semantic_slam.pipeline.gravity.gravity_by_imu import ImuSource
from semantic_slam.pipeline.preamble import read_preamble
from semantic_slam.pipeline.unmeant_labels import UnmeantLabels


def recorded_keyframes(bag: Path, configuration: Configuration, count: int) -> list[Keyframe]:
    """The first ``count`` keyframes, or as many as a damaged bag contains. Raises InputError."""
    identities, imu = absolute(topics.GROUND_TRUTH_ASSOCIATIONS), absolute(topics.IMU)
    found: list[Keyframe] = []
    with BagReader(bag) as reader:
        assembler = KeyframeAssembler(
            configuration,
            has_identities=identities in reader.topics,
            imu=ImuSource(read_preamble(reader).transforms) if imu in reader.topics else None,
        )
        handlers: dict[str, Callable[[Any], None]] = {
            absolute(topics.ODOMETRY): assembler.add_odometry,
            imu: assembler.add_imu,
            topics.MEASUREMENTS: lambda content: assembler.add_measurements(from_message(content)),
            identities: lambda content: assembler.add_identities(from_message(content)),
        }
        try:
            for message in reader.messages(handlers):
                with suppress(MessageError):  # it was already counted during the recording
                    handlers[message.topic](reader.decode(message.cdr, message.type_name))
                found += assembler.take()
        except TruncatedBagError:
            pass  # the bag's beliefs end there, too
        found += assembler.flush()
    unmeant = UnmeantLabels(configuration)
    return [*found[:1], *map(unmeant.without, found[1:])][:count]
