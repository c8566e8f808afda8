"""What axe-core finds on a page: a checker of accessibility that npm has, fetched where there is npm and a network."""

from __future__ import annotations

import shutil
import subprocess
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest

AXE = "axe-core@4.14.1"
RUN = """axe.run(document, {resultTypes: ["violations"]}).then((found) => found.violations.flatMap((rule) =>
    rule.nodes.map((node) => [rule.impact, rule.id, node.html.slice(0, 150), node.failureSummary].join(" | "))))"""


class Axe:
    """Its script, which is put into a page that is open."""

    def __init__(self, script: str):
        self._script = script

    def problems(self, page) -> list[str]:
        """Return what is wrong on a page, of whatever impact, one line for each element."""
        page.evaluate("window.phcontrol?.pause?.()")  # the site has an anchor of that name
        page.add_script_tag(content=self._script)
        return page.evaluate(RUN)


@pytest.fixture(scope="session")
def axe(tmp_path_factory) -> Iterator[Axe]:
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip(f"accessibility is not tested: needs npm, which fetches {AXE}")
    folder = tmp_path_factory.mktemp("axe")
    command = [npm, "pack", "--silent", "--prefer-offline", AXE]
    try:
        fetched = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    except subprocess.TimeoutExpired:
        pytest.skip(f"accessibility is not tested: npm took more than two minutes to fetch {AXE}")
    if fetched.returncode != 0:
        pytest.skip(f"accessibility is not tested: npm could not fetch {AXE}: {fetched.stderr.strip()[:200]}")
    with tarfile.open(folder / Path(fetched.stdout.strip().splitlines()[-1])) as packed:
        script = packed.extractfile("package/axe.min.js")
        assert script is not None
        yield Axe(script.read().decode())
