"""How much of the disk the installed packages take."""

from __future__ import annotations

import os
from collections.abc import Iterator
from importlib import metadata

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name


def sizes_of(package: str) -> dict[str, int]:
    """Return the size in bytes of a package and of each package that it cannot do without, the largest first.

    What is not installed is left out, and so is what only an extra of the package asks for. A package that is installed
    in place (``pip install --editable``) counts with the files of its entry, not with its sources.
    """
    found: dict[str, int] = {}
    seen: set[tuple[str, str]] = set()
    wanted = [(package, "")]
    while wanted:
        name, extra = wanted.pop()
        name = canonicalize_name(name)
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        try:
            distribution = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue
        if name not in found:
            found[name] = sum(_size(str(file.locate())) for file in distribution.files or [])
        wanted += _needed(distribution, extra)
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))


def _needed(distribution: metadata.Distribution, extra: str) -> Iterator[tuple[str, str]]:
    """Yield the names of the packages that one needs here, with an extra of it, and with which extras of theirs."""
    for text in distribution.requires or []:
        try:
            requirement = Requirement(text)
        except InvalidRequirement:  # metadata of long ago
            continue
        if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
            for needed in ("", *requirement.extras):
                yield requirement.name, needed


def _size(path: str) -> int:
    try:
        return os.lstat(path).st_size
    except OSError:  # listed and not there
        return 0
