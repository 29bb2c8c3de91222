"""Summary of a bag for the doctor's checks."""

from pathlib import Path

from tqdm import tqdm

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import Configuration
from semantic_slam.doctor.finding import Finding, of_fault, warning
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.doctor.summarise import Summariser, wanted_topics
from semantic_slam.errors import InputError
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.pipeline.input_topics import offered
from semantic_slam.pipeline.preamble import Preamble, read_preamble


def summarise_bag(
    bag: Path, configuration: Configuration, prior: MapPrior | None
) -> tuple[InputSummary, list[Finding]]:
    """Summarise a bag, with findings on reading it. Raises InputError where it is not a bag."""
    faults: list[Finding] = []
    with BagReader(bag) as reader:
        preamble = Preamble()
        try:
            reader.check_definitions()
            preamble = read_preamble(reader)
            if preamble.late_pose:
                what, remedy = preamble.late_pose.split("; ")
                faults.append(warning("initial pose", what, remedy))
        except InputError as fault:
            faults.append(of_fault("bag", fault))
        summary = InputSummary(
            configuration=configuration,
            prior=prior,
            types=reader.topics,
            counts=reader.counts,
            found=offered(reader.topics),
            preamble=preamble,
        )
        wanted = wanted_topics(summary)
        total = sum(reader.counts[topic] for topic in wanted)
        try:
            with tqdm(reader.messages(wanted), total=total, unit="message", desc=bag.name, leave=False) as messages:
                Summariser(summary, reader.decode).take(messages)
        except InputError as fault:
            faults.append(of_fault("bag", fault))
    return summary, faults
