"""The announcement of the run that a belief bag holds."""

from pathlib import Path

from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import InputError
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode


def recorded_run(bag: Path) -> RunConfiguration | None:
    """The last run that a bag's beliefs are of; None where it has no beliefs, or tells none that can be read."""
    run: RunConfiguration | None = None
    try:
        with BagReader(bag) as reader:
            if topics.BELIEF in reader.topics:
                for message in reader.messages([topics.RUN_CONFIGURATION]):
                    run = decode(message.cdr, message.type_name)
    except InputError:
        pass  # the examination tells what is wrong with the bag
    return run
