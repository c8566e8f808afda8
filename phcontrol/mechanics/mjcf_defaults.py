"""Classes of defaults in MuJoCo's XML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from phcontrol.mechanics.markup import Element
from phcontrol.mechanics.urdf import Findings

_MAIN = "main"
ACTUATORS = (
    "motor",
    "position",
    "velocity",
    "intvelocity",
    "damper",
    "cylinder",
    "muscle",
    "adhesion",
    "general",
    "dcmotor",
)


class Defaults:
    """What elements are given by their class, by the ``childclass`` of a body around them, or by all."""

    def __init__(self, root: Element, findings: Findings) -> None:
        self._classes: dict[str, dict[str, dict[str, str]]] = {_MAIN: {}}
        self._findings = findings
        for element in root:
            if element.tag == "default":
                assert isinstance(element, Element)
                self._read(element, {}, element.get("class", _MAIN))

    def _read(self, default: Element, inherited: Mapping[str, Mapping[str, str]], name: str) -> None:
        known = {tag: dict(values) for tag, values in inherited.items()}
        for element in default:
            if element.tag != "default":
                known[element.tag] = known.get(element.tag, {}) | dict(element.attrib)
        self._classes[name] = known
        for element in default:
            if element.tag == "default":
                assert isinstance(element, Element)
                if "class" not in element.attrib:
                    self._findings.add(element.line, "a <default> inside another has no class")
                self._read(element, known, element.get("class", ""))

    def given(self, element: Element, childclass: str) -> dict[str, str]:
        """Return the attributes of an element, with those of its class in place of what it does not say."""
        name = element.get("class", childclass or _MAIN)
        if name not in self._classes:
            self._findings.add(element.line, f"<{element.tag}> has the unknown class '{name}'")
        return self._classes.get(name, {}).get(element.tag, {}) | dict(element.attrib)

    def inside(self, body: Element, childclass: str = "") -> Iterator[tuple[Element, dict[str, str], Element]]:
        """Yield every element in a body and the bodies in it, what it is given, and the body that it is in."""
        own = body.get("childclass", childclass)
        for element in body:
            assert isinstance(element, Element)
            yield element, self.given(element, own), body
            if element.tag == "body":
                yield from self.inside(element, own)

    def joints(self, root: Element) -> Iterator[tuple[Element, dict[str, str]]]:
        """Yield every joint, and what it is given."""
        for world in root:
            if world.tag == "worldbody":
                assert isinstance(world, Element)
                yield from ((item, given) for item, given, _ in self.inside(world) if item.tag == "joint")

    def actuators(self, root: Element) -> Iterator[tuple[Element, dict[str, str]]]:
        """Yield every actuator, and what it is given."""
        for group in root:
            if group.tag == "actuator":
                for element in group:
                    assert isinstance(element, Element)
                    given = self.given(element, "")
                    # the classes of all actuators are one: that of <general>
                    yield element, self._classes.get(element.get("class", _MAIN), {}).get("general", {}) | given
