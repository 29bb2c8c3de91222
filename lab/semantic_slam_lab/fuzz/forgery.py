"""Messages that nobody of a run sends, and what in each of them reveals it; every draw is of the generator given.

What nothing reveals, a message of the right form, run and turn with other numbers, is not among them: ROS asks nobody
who he is.
"""

from collections.abc import Callable
from dataclasses import dataclass

from numpy.random import Generator

from semantic_slam.messages import topics
from semantic_slam.messages.codec import BY_TYPE_NAME, encode
from semantic_slam.messages.ground_truth import ReplayProgress
from semantic_slam.messages.layout import MayBeEmpty, Shape
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.messages.typestore import HEADER, MOST_BEHIND, deserialize, serialize

ROUNDS = (topics.KEYFRAMES, topics.COMMITS, topics.CANDIDATES, topics.COMPONENTS, topics.MISSED)
PROGRESS = (topics.PLAYER_PROGRESS, topics.CLASSIFIER_PROGRESS, topics.MANAGER_PROGRESS)
STAMPED = (topics.DETECTIONS, topics.MEASUREMENTS, topics.ODOMETRY)
NO_BACKEND = 77
LONGEST = 600
FAR = 1_000
"""Keyframes, and at least as many seconds, that nobody is ahead."""


@dataclass(frozen=True)
class Forgery:
    """One message on its way."""

    topic: str
    kind: str
    data: bytes


def garbage(topic: str, genuine: bytes, chance: Generator) -> bytes:
    """Any bytes, in every other case behind the head of a message; more than an array of bytes could ever hold."""
    head = b"\x00\x01\x00\x00" if chance.random() < 0.5 else b""
    return head + b"\xff" * 12 + chance.bytes(int(chance.integers(MOST_BEHIND + 1, LONGEST)))


def cut(topic: str, genuine: bytes, chance: Generator) -> bytes:
    """The beginning of a message; of nothing at all DDS delivers nothing."""
    return genuine[: int(chance.integers(HEADER, max(HEADER + 1, len(genuine) - MOST_BEHIND)))]


def unequal(topic: str, genuine: bytes, chance: Generator) -> bytes | None:
    """One of several arrays that belong together, too short; None where there are none."""
    message = deserialize(genuine, topics.TYPES[topic])
    layout = BY_TYPE_NAME[message.__msgtype__].layout if message.__msgtype__ in BY_TYPE_NAME else {}
    free = [name for name, shape in layout.items() if _is_tied(shape) and len(getattr(message, name))]
    if len(free) < 2:
        return None
    name = free[chance.integers(len(free))]
    setattr(message, name, getattr(message, name)[:-1])
    return serialize(message)


def _is_tied(shape: Shape) -> bool:
    """Whether an array has to be as long as others say."""
    return not isinstance(shape, MayBeEmpty) and any(isinstance(size, str) for size in shape)


def of_another_run(topic: str, genuine: bytes, chance: Generator) -> bytes | None:
    """A message of a run that nobody announced, or an announcement under an id that is not that of its contents."""
    if topic not in (*ROUNDS, topics.RUN_CONFIGURATION):
        return None
    message = deserialize(genuine, topics.TYPES[topic])
    message.run_id = chance.bytes(8).hex()
    return serialize(message)


def out_of_turn(topic: str, genuine: bytes, chance: Generator) -> bytes | None:
    """A message of a keyframe, a backend or a time that it cannot be of; None where nothing tells that."""
    message = deserialize(genuine, topics.TYPES[topic])
    if topic in (topics.CANDIDATES, topics.COMPONENTS, topics.MISSED) and chance.random() < 0.5:
        message.backend_id = NO_BACKEND
    elif topic in (*ROUNDS, topics.BELIEF):
        message.keyframe += FAR + int(chance.integers(FAR))
    elif topic in STAMPED:
        message.header.stamp.sec += FAR * int(1 + chance.integers(FAR))
    else:
        return None
    return serialize(message)


def boast(topic: str, genuine: bytes, chance: Generator) -> bytes | None:
    """Progress that nobody can have made, or an end before what has come already."""
    if topic not in PROGRESS:
        return None
    frames = 0 if topic == topics.PLAYER_PROGRESS else int(chance.integers(10**6, 10**12))
    finished = topic == topics.MANAGER_PROGRESS or bool(chance.integers(2))
    stamp_ns = int(chance.integers(1, FAR)) * NANOSECONDS
    return encode(ReplayProgress(stamp_ns, frames=frames, finished=finished))


def again(topic: str, genuine: bytes, chance: Generator) -> bytes:
    """What was sent before."""
    return genuine


KINDS: dict[str, Callable[[str, bytes, Generator], bytes | None]] = {
    kind.__name__: kind for kind in (garbage, cut, unequal, of_another_run, out_of_turn, boast, again)
}


WITHOUT_GENUINE = (garbage.__name__, boast.__name__)


def forgery(topic: str, genuine: list[bytes], chance: Generator) -> Forgery:
    """One for this topic, made of what was sent on it before, where anything was."""
    kinds = list(KINDS) if genuine else WITHOUT_GENUINE
    while True:
        kind = kinds[chance.integers(len(kinds))]
        data = KINDS[kind](topic, genuine[chance.integers(len(genuine))] if genuine else b"", chance)
        if data is not None:
            return Forgery(topic, kind, data)
