"""A detector of another maker: names out of the box, and after other bags have taught."""

from collections.abc import Callable

from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table, value
from semantic_slam_lab.documentation.writing.methods_table import Column
from semantic_slam_lab.documentation.writing.section import Section
from semantic_slam_lab.studies.own_detector.pages import TITLES, WORDS

STUDY = "own_detector"
COLUMNS = (
    Column("NLL at the end", "nll", ".2g"),
    Column("ECE", "ece", ".3f"),
    Column("right", "correct_rate_final", ".0%"),
    Column("NLL on the way", "nll_online", ".2f"),
    Column("ECE on the way", "ece_online", ".3f"),
    Column("settled", "settled_share", ".0%"),
    Column("after keyframes", "settled_keyframe", ".1f"),
)


def of_line(line: str) -> Callable[[KeptResults], str]:
    """A table of every method where the detector confuses things in one way."""

    def made(results: KeptResults) -> str:
        methods = results.results[STUDY]["lines"][line]["methods"]
        rows = [
            (WORDS.get(name, name), *(value(row[column.key], column.style) for column in COLUMNS))
            for name, row in methods.items()
        ]
        return table(("method", *(column.heading for column in COLUMNS)), rows)

    return made


SECTIONS = (
    Section(
        STUDY,
        "A detector of one's own",
        "Six rendered rooms, four bags of each on every line: a detector with eleven names of its own, three hypotheses"
        " a box, 20 % confused, 15 % missed, a false alarm in ten frames; no map, nothing trained. By view it is one"
        " detector in all bags; by side each object is confused in a way of its own, and other bags can teach only how"
        " views repeat. *After `fit --from-run`*: one bag of each other room was run before, without anybody's labels.",
        tuple((title, of_line(line)) for line, title in TITLES.items()),
    ),
)
