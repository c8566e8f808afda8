"""XML with line numbers, from files that nobody vouches for."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET
from xml.parsers import expat

from phcontrol.exceptions import RobotDescriptionError

DEEPEST = 100
"""Elements inside one another; a URDF has six or so. What walks a tree deeper than this would run out of stack."""
LARGEST_FILE = 64_000_000
"""Bytes; descriptions have 1e5 or so."""


class Element(ET.Element):
    """An element that knows its line."""

    line = 0


def read_markup(path: Path, label: str) -> Element:
    """Return the root of an XML file in UTF-8; ``label`` is what errors call it. Raises RobotDescriptionError."""
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise RobotDescriptionError(f"{label}: has more than {LARGEST_FILE} bytes, which no description needs")
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise RobotDescriptionError(f"{label}: cannot be read: {error}") from error
    return parse_markup(text, label)


def parse_markup(text: str, label: str) -> Element:
    """Return the root of an XML document; ``label`` is what errors call it. Raises RobotDescriptionError.

    Without document type declarations there are no entities: nothing is expanded and no other file is read.
    """
    parser = expat.ParserCreate(encoding="utf-8")
    builder = ET.TreeBuilder(element_factory=Element)
    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise RobotDescriptionError(
                f"{label}, line {parser.CurrentLineNumber}: more than {DEEPEST} elements inside one another; "
                "a description needs six or so"
            )
        element = builder.start(tag, attributes)
        assert isinstance(element, Element)
        element.line = parser.CurrentLineNumber

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def doctype(*_: object) -> None:
        raise RobotDescriptionError(f"{label}: has a document type declaration, which a URDF never needs; refused")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = builder.data, doctype
    try:
        parser.Parse(text.encode(), True)
        root = builder.close()
    except (expat.ExpatError, UnicodeEncodeError) as error:
        raise RobotDescriptionError(f"{label}: not well-formed XML: {error}") from error
    assert isinstance(root, Element)
    return root
