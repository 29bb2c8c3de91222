"""The page that follows a run: its own parts, and those that it has from the report."""

import jinja2

from semantic_slam.report.rendering import environment

HTML, CSS, SCRIPT = ("text/html; charset=utf-8", "text/css; charset=utf-8", "text/javascript; charset=utf-8")
ICON = "image/svg+xml"


def assets() -> dict[str, tuple[str, bytes]]:
    """Media type and contents of all that never changes, by address."""
    parts = environment()
    parts.loader = jinja2.ChoiceLoader(
        [jinja2.PackageLoader("semantic_slam.view"), jinja2.PackageLoader("semantic_slam.report")]
    )

    def part(name: str) -> bytes:
        assert parts.loader is not None
        return parts.loader.get_source(parts, name)[0].encode()

    return {
        "/": (HTML, parts.get_template("view.html").render().encode()),
        "/icon.svg": (ICON, part("icon.svg")),
        "/report.css": (CSS, part("report.css")),
        "/view.css": (CSS, part("view.css")),
        **{f"/{name}": (SCRIPT, part(name)) for name in ("map.js", "space.js", "plots.js", "view.js")},
    }
