"""The keyframes of a recorded run: made again from the measurements and the odometry in its belief bag."""

from pathlib import Path

from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import BagReader, TruncatedBagError
from semantic_slam.configuration import Configuration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.messages import topics
from semantic_slam.messages.codec import from_message
from semantic_slam.pipeline.keyframe_assembler import KeyframeAssembler


def recorded_keyframes(bag: Path, configuration: Configuration, count: int) -> list[Keyframe]:
    """The first ``count`` keyframes, or as many as a damaged bag still tells. Raises InputError."""
    odometry, measurements, identities = (
        absolute(topic) for topic in (topics.ODOMETRY, topics.MEASUREMENTS, topics.GROUND_TRUTH_ASSOCIATIONS)
    )
    found: list[Keyframe] = []
    with BagReader(bag) as reader:
        assembler = KeyframeAssembler(configuration, has_identities=identities in reader.topics)
        try:
            for message in reader.messages([odometry, measurements, identities]):
                content = reader.decode(message.cdr, message.type_name)
                if message.topic == odometry:
                    assembler.add_odometry(content)
                elif message.topic == measurements:
                    assembler.add_measurements(from_message(content))
                else:
                    assembler.add_identities(from_message(content))
                found += assembler.take()
        except TruncatedBagError:
            pass  # beliefs end there, too
        found += assembler.flush()
    return found[:count]
