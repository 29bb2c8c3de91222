"""``python -m semantic_slam_lab.documentation.build``: write the generated pages, or say which are out of date."""

import argparse
from pathlib import Path

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import InputError
from semantic_slam_lab.documentation.fill import Tables, filled
from semantic_slam_lab.documentation.headline import headline
from semantic_slam_lab.documentation.messages import messages_page
from semantic_slam_lab.documentation.parameters import default_file, parameters_page
from semantic_slam_lab.documentation.results import results_page
from semantic_slam_lab.documentation.studies.rooms import ROOMS, VICTORIA_PARK
from semantic_slam_lab.documentation.writing.kept_results import KeptResults, keep, read_kept

GENERATED = "<!-- Written by `make docs`; edits here are lost. -->\n\n"
FILLED = ("README.md", "docs/*.md")
"""Pages written by hand in which values and tables are marked."""
TABLES: Tables = {"headline": headline, "rooms": ROOMS, "victoria_park": VICTORIA_PARK}


def pages(root: Path) -> dict[Path, str]:
    """Every page with generated content below ``root``, a checkout, and what it has to say. Raises InputError."""
    results = read_kept(root / "docs" / "results")
    made = {root / "docs" / name: GENERATED + text for name, text in _whole_pages(root, results).items()}
    made[root / "config" / "default.yaml"] = default_file()
    by_hand = [path for pattern in FILLED for path in sorted(root.glob(pattern)) if path not in made]
    return made | {path: filled(path.read_text(encoding="utf-8"), results, TABLES) for path in by_hand}


def _whole_pages(root: Path, results: KeptResults) -> dict[str, str]:
    return {
        "parameters.md": parameters_page(),
        "messages.md": messages_page(root / "msg_defs"),
        "results.md": results_page(results),
    }


def outdated(root: Path) -> list[Path]:
    """Pages that differ from what they would say now."""
    return [path for path, text in pages(root).items() if not path.is_file() or path.read_text("utf-8") != text]


def parse(words: list[str] | None = None) -> argparse.Namespace:
    """Arguments of the command line; raises InputError."""
    parser = CommandParser(prog="documentation.build", description="Write README.md's and docs/'s generated parts.")
    parser.add_argument("--root", type=Path, default=Path(), help="the checkout (default: here)")
    parser.add_argument("--check", action="store_true", help="write nothing; exit 2 where a page is out of date")
    parser.add_argument("--keep", type=Path, nargs="+", default=[], metavar="FILE", help="results to keep first")
    parser.add_argument("--remark", default="", help="what a reader of the kept numbers has to know")
    return parser.parse_args(words)


def command() -> None:
    """Keep, then write or check; raises InputError."""
    arguments = parse()
    root: Path = arguments.root
    if not (root / "msg_defs").is_dir():
        raise InputError(f"{root}: no checkout of semantic_slam; name one with --root")
    for path in arguments.keep:
        print(keep(path, root / "docs" / "results", arguments.remark))
    found = outdated(root)
    if arguments.check and found:
        raise InputError(f"{', '.join(map(str, found))}: out of date; run make docs")
    for path in found:
        path.write_text(pages(root)[path], encoding="utf-8")
        print(path)


def main() -> None:
    run_main(command)


if __name__ == "__main__":
    main()
