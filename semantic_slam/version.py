"""The version of this package, which stands in package.xml alone."""

from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

PACKAGE_XML = Path(__file__).resolve().parents[1] / "package.xml"
"""The package.xml of a checkout, which may run without being installed; an installed package has metadata instead."""


def _version() -> str:
    """Version in a checkout's package.xml, or of the installed distribution."""
    if PACKAGE_XML.is_file():
        return ElementTree.parse(PACKAGE_XML).findtext("version", "")
    return version("semantic_slam")


__version__ = _version()
