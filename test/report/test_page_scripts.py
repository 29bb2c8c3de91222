"""The scripts of pages, in a JavaScript engine without a browser: they parse, and what draws nothing is right."""

import json
import re
from importlib import resources
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds.belief_factory import write_belief_bag

from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.evaluation.history import lineage
from semantic_slam.geometry import so3
from semantic_slam.report.make import make_report
from semantic_slam.report.summary import SummaryRow, summary_files
from semantic_slam.report.wording import percent
from semantic_slam.view.page import assets

quickjs = pytest.importorskip("quickjs", reason="requirements/tools.txt has it")

KEYFRAMES = 24
OF_LIVE_VIEW = ("/map.js", "/space.js", "/plots.js", "/view.js")
SCRIPT = re.compile(r"<script( [^>]*)?>(.*?)</script>", re.DOTALL)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A belief bag, and the page of its report."""
    folder = tmp_path_factory.mktemp("made")
    beliefs, _ = write_belief_bag(folder, KEYFRAMES)
    make_report(beliefs, folder / "report")
    return beliefs, (folder / "report" / "report.html").read_text()


def own_scripts(page: str) -> list[str]:
    """What a page runs."""
    return [text for told, text in SCRIPT.findall(page) if "json" not in told]


def template(name: str) -> str:
    return (resources.files("semantic_slam.report") / "templates" / name).read_text()


def drawing(scene: dict[str, Any] | None = None) -> Any:
    """Engine with what the maps of pages are drawn by; nothing of it looks at the page before it is called."""
    engine = quickjs.Context()
    engine.eval(template("map.js") + template("space.js"))
    if scene is not None:
        engine.eval(f"const scene = {json.dumps(scene)};")
    return engine


def value(engine: Any, expression: str) -> Any:
    return json.loads(engine.eval(f"JSON.stringify({expression})"))


def parse(script: str) -> None:
    """Raise for a script that an engine refuses as a whole, also for a name that it has twice."""
    quickjs.Context().eval(f"(() => {{{script}\n}})")


def test_scripts_of_every_page_parse(made: tuple[Path, str]) -> None:
    summary = summary_files([SummaryRow(name="drive", bag="x", fault="", metrics={})])["index.html"]
    pages = {"report": made[1], "summary": summary}
    for name, page in pages.items():
        (script,) = own_scripts(page)
        assert len(script) > 500, name
        parse(script)
    parse("\n".join(template(name) for name in ("map.js", "plots.js", "space.js", "report.js")))  # of a run in space
    parse("\n".join(assets()[name][1].decode() for name in OF_LIVE_VIEW))
    with pytest.raises(quickjs.JSException, match="redefinition"):
        parse(template("map.js") + "const GREY = 1;")


def test_pages_round_probabilities_as_texts_do() -> None:
    engine = drawing()
    near = [1e-12, 1e-4, 4.9e-4, 5e-4, 0.0099, 0.01, 0.49, 0.9949, 0.995, 0.9994, 0.9995, 0.9999, 1 - 1e-10, 1.0, 0.0]
    for p in (*near, *np.random.default_rng(0).uniform(size=200).tolist()):
        assert engine.eval(f"percent({p!r})") == percent(p)


def test_every_frame_of_a_page_has_the_objects_of_its_belief(made: tuple[Path, str]) -> None:
    """A page states objects where they change alone."""
    bag, page = made
    (data,) = [text for told, text in SCRIPT.findall(page) if "json" in told]
    engine, beliefs = drawing(scene := json.loads(data)), read_record(bag).beliefs
    engine.eval("const objectsAt = []; let now = scene.objects.map(() => null);")
    engine.eval("for (const frame of scene.frames) objectsAt.push(now = objectsAfter(now, frame));")
    labels = [each["label"] for each in scene["objects"]]
    for belief, objects in zip(beliefs, value(engine, "objectsAt"), strict=True):
        for row in np.flatnonzero(belief.existence > 0.5):
            there = next(
                objects[place] for place, name in enumerate(labels) if name.endswith(str(belief.object_ids[row]))
            )
            np.testing.assert_allclose(there[:2], belief.object_poses[row, :2], atol=0.02)
    best = lineage(beliefs)
    engine.eval("const shown = scene.frames.length - 1;")
    told = value(engine, "track(shown, heaviest(scene.frames[shown])).reverse()")
    true = [belief.poses[row, :2] for belief, row in zip(beliefs, best, strict=True)]
    np.testing.assert_allclose([row[2:4] for row in told], true, atol=1e-3)


def test_vectors_turn_by_quaternions_as_they_do_in_inference() -> None:
    generator, engine = np.random.default_rng(1), drawing()
    for rotation, vector in generator.normal(size=(20, 2, 3)):
        q = so3.exp(rotation)
        found = value(engine, f"turned({q.tolist()}, {vector.tolist()})")
        np.testing.assert_allclose(found, so3.matrix(q) @ vector, atol=1e-12)


def test_names_lie_on_the_map_and_over_no_other() -> None:
    """Of a crowd of names some find no place; of names far apart each stands to the right of its point."""
    engine = drawing()
    engine.eval("const taken = [];")
    points = np.random.default_rng(2).uniform((0.0, 0.0), (300.0, 200.0), size=(60, 2)).tolist()
    found = [value(engine, f"freePlace({x}, {y}, 50, taken, 300, 200, 12)") for x, y in points]
    boxes = value(engine, "taken")
    assert 10 < len(boxes) < len(points) and found.count(None) == len(points) - len(boxes)
    assert all(0 <= left < right <= 300 and 0 <= top < low <= 200 for left, top, right, low in boxes)
    for (a0, b0, a1, b1), (c0, d0, c1, d1) in combinations(boxes, 2):
        assert a1 <= c0 or c1 <= a0 or b1 <= d0 or d1 <= b0
    assert value(engine, "freePlace(50, 50, 40, [], 300, 200, 12)") == [62, 43]
