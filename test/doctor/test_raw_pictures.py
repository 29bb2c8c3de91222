"""Raw pictures that are larger than what their writer keeps are told by how many of them do not come."""

import numpy as np
import pytest
from worlds.bags.bag_factory import HEIGHT, WIDTH, input_entries, map_prior, of_topic, without
from worlds.bags.mistakes import Entries
from worlds.bags.raw_image import raw_image

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.names import absolute
from semantic_slam.configuration import from_dict
from semantic_slam.doctor.examination import examine
from semantic_slam.doctor.finding import Finding, Severity
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.doctor.summarise import Summariser
from semantic_slam.messages import topics
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.pipeline.input_topics import offered
from semantic_slam.pipeline.preamble import Preamble

FRAMES = 24
CONFIGURATION = from_dict({"semantic_model": {"kind": "none"}, "perception": {"depth_to_width": 0.0}})


def raw(entries: Entries, times: int) -> Entries:
    """Colour as a driver publishes it, so many times as large as the small bag has it."""
    for entry in of_topic(entries, topics.IMAGE_COMPRESSED):
        entry.topic = topics.IMAGE
        entry.message = raw_image(entry.message.header, np.zeros((times * HEIGHT, times * WIDTH, 3), np.uint8), "rgb8")
    return entries


def lacking_pictures(entries: Entries, kept: int) -> Entries:
    """Only every so many pictures have come."""
    pictures = of_topic(entries, topics.IMAGE)
    lost = {id(entry) for n, entry in enumerate(pictures) if n % kept}
    return [entry for entry in entries if id(entry) not in lost]


def found_in(entries: Entries, *, is_live: bool) -> list[Finding]:
    messages = [
        RawMessage(absolute(entry.topic), entry.message.__msgtype__, entry.stamp_ns, serialize(entry.message))
        for entry in entries
    ]
    types = {message.topic: message.type_name for message in messages}
    summary = InputSummary(
        configuration=CONFIGURATION,
        prior=map_prior(),
        types=types,
        counts={topic: sum(message.topic == topic for message in messages) for topic in types},
        found=offered(types),
        preamble=Preamble(),
        is_live=is_live,
    )
    for entry in of_topic(entries, topics.TF_STATIC):
        summary.preamble.transforms.add(entry.message)
    Summariser(summary, deserialize).take(messages)
    return [finding for finding in examine(summary) if finding.check in ("raw pictures", "matching")]


def drive(times: int) -> Entries:
    return raw(without(input_entries(FRAMES), topics.DEPTH_COMPRESSED), times)


@pytest.mark.parametrize(("kept", "severity", "lost"), [(2, Severity.WARNING, 12), (3, Severity.ERROR, 16)])
def test_large_pictures_that_do_not_come_are_told_with_their_remedy(kept: int, severity: Severity, lost: int) -> None:
    (found,) = found_in(lacking_pictures(drive(4), kept), is_live=True)
    assert (found.check, found.severity) == ("raw pictures", severity)
    assert f"/image: {lost} of 24 pictures of 922 kB have not come" in found.what
    assert "config/fastdds_pictures.xml" in found.remedy


def test_large_pictures_that_come_are_well() -> None:
    assert found_in(drive(4), is_live=True) == []


def test_pictures_that_fit_or_lie_in_a_bag_are_of_no_picture_where_they_lack() -> None:
    small, recorded = lacking_pictures(drive(1), 3), lacking_pictures(drive(4), 3)
    for entries, is_live in ((small, True), (recorded, False)):
        assert [finding.check for finding in found_in(entries, is_live=is_live)] == ["matching"]
