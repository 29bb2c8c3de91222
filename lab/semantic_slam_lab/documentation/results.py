"""docs/results.md, from the kept results."""

import re
from typing import Any

from semantic_slam_lab.documentation.studies import (
    benchmarks,
    carried_robot,
    chapter_3,
    chapter_4,
    chapter_5,
    desks,
    drawn_worlds,
    embeddings,
    faulty_rooms,
    fuzz,
    kills,
    lost_robot,
    novelty,
    overload,
    own_detector,
    photographs,
    real_drives,
    real_in_space,
    real_turntables,
    rooms,
    tables,
)
from semantic_slam_lab.documentation.writing.kept_results import KeptResults
from semantic_slam_lab.documentation.writing.markdown import table
from semantic_slam_lab.documentation.writing.section import Section

INTRODUCTION = """# Results

Every number on this page is written by `make docs` from a file in `docs/results`, which a study or the benchmark wrote;
a test fails where page and file differ. Claims are the thesis's, or requirements of this project, and stand here
also where they do not hold. Times depend on the machine named beside them.

```bash
run_study NAME --out out/NAME       # result.json and a page with figures; run_study --list
make bench                          # out/bench.json
python -m semantic_slam_lab.documentation.build --keep out/*/result.json out/bench.json
```
"""

SECTIONS = tuple(
    section
    for part in (
        rooms,
        real_drives,
        real_turntables,
        photographs,
        novelty,
        embeddings,
        own_detector,
        faulty_rooms,
        lost_robot,
        carried_robot,
        tables,
        real_in_space,
        desks,
        drawn_worlds,
        kills,
        fuzz,
        overload,
        chapter_4,
        chapter_3,
        chapter_5,
        benchmarks,
    )
    for section in part.SECTIONS
)


def results_page(results: KeptResults) -> str:
    """Markdown: a section for each study of which a result is kept, and what is missing."""
    kept = [section for section in SECTIONS if results.has(section.study)]
    missing = [section.study for section in SECTIONS if not results.has(section.study)]
    note = f"\nNot run for this version: {', '.join(f'`{name}`' for name in missing)}.\n" if missing else ""
    return "\n".join([INTRODUCTION + note, _overview(kept, results), *(_section(section, results) for section in kept)])


def _overview(kept: list[Section], results: KeptResults) -> str:
    """Every study with how many of its claims hold."""
    rows = []
    for section in kept:
        result = results.results[section.study]
        claims = result.get("claims", [])
        held = f"{sum(claim['holds'] for claim in claims)} of {len(claims)}" if claims else "–"
        rows.append((f"[{section.title}](#{_slug(section.title)})", held, "quick" if result.get("quick") else "whole"))
    return table(("study", "claims that hold", "run"), rows)


def _slug(title: str) -> str:
    """Anchor of a heading, as mkdocs and GitHub make it."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def _section(section: Section, results: KeptResults) -> str:
    result = results.results[section.study]
    text = [f"## {section.title}", "", section.text, "", _provenance(section, result), ""]
    for caption, make in section.tables:
        text += [f"**{caption}**", ""] if caption else []
        text.append(make(results))
    if result.get("claims"):
        text += [f'<details markdown="1"><summary>{_held(result["claims"])}</summary>', "", _claims(result["claims"])]
        text += ["</details>", ""]
    return "\n".join(text)


def _provenance(section: Section, result: dict[str, Any]) -> str:
    study = section.study
    command = (section.command or f"run_study {study}") + (" --quick" if result.get("quick") else "")
    machine = result.get("machine")
    where = f"{machine['cpu']}, {machine['cores']} cores, Python {machine['python']}" if machine else "machine unknown"
    quick = " **A quick run, not the whole study.**" if result.get("quick") else ""
    remark = f" {result['remark']}" if "remark" in result else ""
    source = f"[{study}.json](results/{study}.json)"
    revision = result.get("revision", "unknown")
    return f"`{command}`, seed {result.get('seed', 0)}, revision `{revision}`, {where}: {source}.{quick}{remark}"


def _claims(claims: list[dict[str, Any]]) -> str:
    rows = [
        (
            claim["text"],
            claim["source"],
            claim["thesis"] or "–",
            claim["measured"],
            "yes" if claim["holds"] else "**no**",
        )
        for claim in claims
    ]
    return table(("claim", "source", "reported there", "measured here", "holds"), rows)


def _held(claims: list[dict[str, Any]]) -> str:
    return f"{sum(claim['holds'] for claim in claims)} of {len(claims)} claims hold"
