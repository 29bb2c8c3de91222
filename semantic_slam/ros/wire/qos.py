"""QoS profiles of all topics.

RELIABLE with KEEP_ALL on both ends loses no message: a writer blocks until its slowest reader has room. KEEP_LAST on
either end loses messages when a reader is slow, whatever the reliability. In a lossless replay small messages are also
kept for late-joining readers (TRANSIENT_LOCAL, the newest 5000), so that nodes may be started in any order.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from semantic_slam.messages import topics

SENSOR_DEPTH = 50
FAST_DEPTH = 5000
"""Queue length for odometry, transforms and IMU: they are cheap to process, and gaps make motions uncertain."""
FAST = frozenset({topics.ODOMETRY, topics.IMU, topics.TF, topics.GROUND_TRUTH_ODOMETRY})
TRANSFORMS_DEPTH = 100
PICTURES = frozenset({topics.IMAGE, topics.IMAGE_COMPRESSED, topics.DEPTH, topics.DEPTH_COMPRESSED, topics.DISPARITY})


def everything() -> QoSProfile:
    """RELIABLE and KEEP_ALL, volatile: nothing is lost once the endpoints are matched."""
    return QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_ALL)


def everything_from_the_start() -> QoSProfile:
    """RELIABLE, KEEP_ALL and TRANSIENT_LOCAL: late or restarted readers receive earlier messages, too."""
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        history=HistoryPolicy.KEEP_ALL,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def latched() -> QoSProfile:
    """Latched topic: RELIABLE, TRANSIENT_LOCAL and KEEP_LAST 1, so that late readers get the last message."""
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        history=HistoryPolicy.KEEP_LAST,
        depth=1,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def latched_by_any() -> QoSProfile:
    """For readers of :func:`latched` topics: KEEP_ALL, so that a second publisher's message does not displace one."""
    return everything_from_the_start()


def newest() -> QoSProfile:
    """RELIABLE and KEEP_LAST 1, volatile: only the newest message matters, as with /clock."""
    return QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=1)


def transforms() -> QoSProfile:
    """QoS of /tf as tf2's own broadcasters have it: reliable, and a reader that is stuck never blocks the writer."""
    return QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=TRANSFORMS_DEPTH)


def replayed(topic: str) -> QoSProfile:
    """QoS of the player's publishers; images are too large to be kept for late readers."""
    return everything() if topic in PICTURES else everything_from_the_start()


def sensor_input(topic: str, lossless: bool) -> QoSProfile:
    """QoS of an input subscription: lossless from our player, else BEST_EFFORT, which matches any driver."""
    if topic in topics.LATCHED:
        return everything_from_the_start()
    if lossless:
        return replayed(topic)
    depth = FAST_DEPTH if topic in FAST else SENSOR_DEPTH
    return QoSProfile(reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=depth)


def result(lossless: bool) -> QoSProfile:
    """QoS of our outputs: with history in a lossless replay; none in live operation, where it would grow."""
    return everything_from_the_start() if lossless else everything()
