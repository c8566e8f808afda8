"""The documentation as a site: built without a warning, drawn without an error, with nothing asked from a network."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import phcontrol

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.xdist_group("site")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("mkdocs", reason="needs the extra 'docs'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return folder


def test_every_public_name_is_documented(site):
    text = "".join(path.read_text() for path in (site / "api").glob("*.html"))
    constants = {"CONTROLLERS", "INTEGRATORS", "NOTHING", "__version__"}
    missing = [name for name in phcontrol.__all__ if f'id="phcontrol.{name}"' not in text and name not in constants]
    assert missing == []


def test_what_docstrings_refer_to_is_linked(site):
    """No role is left as it was written, and every link leads to a name that is on its page."""
    texts = {path.name: path.read_text() for path in (site / "api").glob("*.html")}
    links = {link for text in texts.values() for link in re.findall(r'href="(\w+\.html)#(phcontrol\.[\w.]+)"', text)}
    assert len(links) > 10
    for page, anchor in links:
        assert f'id="{anchor}"' in texts[page], anchor
    for name, text in texts.items():
        assert re.findall(r":(?:class|func|meth):.{40}", text) == [], name


@pytest.mark.browser
def test_pages_in_a_browser(browser, site):
    for path in sorted(site.glob("**/*.html")):
        if path.name == "404.html":
            continue
        with browser.open(path.as_uri(), ready=None) as page:
            assert page.locator("h1").count() == 1, path
            assert page.problems == [], path
            assert [request for request in page.requests if not request.startswith(("file:", "data:"))] == []
            if path.name == "theory.html":
                formulas = page.locator("math[display=block]")
                assert formulas.count() >= 6
                for formula in formulas.all():
                    box = formula.bounding_box()
                    assert box["width"] > 100
                    assert box["height"] > 15
                assert "$$" not in page.inner_text("article")
            if path.name == "architecture.html":
                assert page.evaluate("document.querySelector('article img').naturalWidth") > 300


@pytest.mark.browser
def test_the_site_is_searched_from_a_folder(browser, site):
    with browser.open((site / "api" / "safety.html").as_uri(), ready=None) as page:
        page.locator("input.md-search__input").press_sequentially("energy tank")
        page.locator(".md-search-result__link").first.wait_for()
        assert "matching documents" in page.locator(".md-search-result__meta").inner_text()
        page.locator(".md-search-result__link").first.click()
        page.wait_for_url("**/api/tanks.html*")
        assert page.problems == []


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_wrong_on_the_site(browser, axe, site, scheme):
    found = []
    for path in sorted(site.glob("**/*.html")):
        if path.name == "404.html":  # asks a server for its style
            continue
        with browser.open(path.as_uri(), ready=None) as page:
            page.emulate_media(color_scheme=scheme)
            found += [f"{path.relative_to(site)}: {problem}" for problem in axe.problems(page)]
    assert found == []
