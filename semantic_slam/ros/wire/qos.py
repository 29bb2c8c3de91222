"""Quality of service, decided once.

RELIABLE with KEEP_ALL on both ends loses nothing: a writer waits for its slowest reader. KEEP_LAST on either end
loses messages as soon as a reader is slow, whatever the reliability. A lossless replay also keeps its small messages
for readers that appear late (TRANSIENT_LOCAL, the newest 5000), so that no node has to be started before another.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from semantic_slam.messages import topics

SENSOR_DEPTH = 50
PICTURES = frozenset({topics.IMAGE, topics.IMAGE_COMPRESSED, topics.DEPTH, topics.DEPTH_COMPRESSED})


def everything() -> QoSProfile:
    """Reliable quality of service that keeps all: nothing is lost once both ends know each other."""
    return QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_ALL)


def everything_from_the_start() -> QoSProfile:
    """Reliable quality of service that keeps all, and a late or restarted reader receives what was published before."""
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        history=HistoryPolicy.KEEP_ALL,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def latched() -> QoSProfile:
    """Quality of service that gives every late reader the one last message."""
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        history=HistoryPolicy.KEEP_LAST,
        depth=1,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def latched_by_any() -> QoSProfile:
    """Reader of :func:`latched` topics: of two publishers, one of which is not meant, none displaces the other."""
    return everything_from_the_start()


def newest() -> QoSProfile:
    """Quality of service where only the newest message matters, as with /clock."""
    return QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=1)


def replayed(topic: str) -> QoSProfile:
    """What the player offers; pictures are too large to be kept for late readers."""
    return everything() if topic in PICTURES else everything_from_the_start()


def sensor_input(topic: str, lossless: bool) -> QoSProfile:
    """An input: lossless from our player, or as a driver publishes it (matches BEST_EFFORT and RELIABLE writers)."""
    if topic in topics.LATCHED:
        return everything_from_the_start()
    if lossless:
        return replayed(topic)
    return QoSProfile(reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=SENSOR_DEPTH)


def result(lossless: bool) -> QoSProfile:
    """An output of ours; live, no ever-growing history is kept."""
    return everything_from_the_start() if lossless else everything()
