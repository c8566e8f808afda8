"""A cache of compiled laws that is the test run's own, and a line where laws cannot be compiled."""

from __future__ import annotations

import importlib.util
import os

import pytest

from phcontrol.compilation.compiler import find_compiler

HAS_CASADI = importlib.util.find_spec("casadi") is not None


def pytest_ignore_collect(collection_path):
    """Without CasADi the modules cannot be imported: they are skipped as a whole, by one line."""
    return True if not HAS_CASADI and collection_path.name.startswith("test_") else None


def pytest_report_header():
    return None if HAS_CASADI else "tests/compilation: skipped, casadi is not installed"


@pytest.fixture(autouse=True, scope="session")
def own_cache(tmp_path_factory):
    before = os.environ.get("PHCONTROL_CACHE")
    os.environ["PHCONTROL_CACHE"] = str(tmp_path_factory.mktemp("cache") / "compiled")
    yield
    if before is None:
        del os.environ["PHCONTROL_CACHE"]
    else:
        os.environ["PHCONTROL_CACHE"] = before


@pytest.fixture
def compiler():
    found = find_compiler()
    if found is None:
        pytest.skip("no C compiler: laws cannot be compiled here")
    return found
