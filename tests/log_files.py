"""The files of logs, taken apart and put together again by hand, as a stranger would."""

from __future__ import annotations

import hashlib
import json

import numpy as np


def contents(path):
    """Return the arrays of a log's file."""
    with np.load(path) as file:
        return dict(file)


def text(**content):
    """Return JSON as a log's file holds it."""
    return np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)


def seal(arrays):
    """Return the arrays with a hash that fits them."""
    arrays = {name: array for name, array in arrays.items() if name != "sha256"}
    digest = hashlib.sha256()
    for name in sorted(set(arrays) - {"metadata"}):
        digest.update(f"{name} {arrays[name].shape}\n".encode() + np.ascontiguousarray(arrays[name]).tobytes())
    if "metadata" in arrays:
        digest.update(b"metadata\n" + arrays["metadata"].tobytes())
    return arrays | {"sha256": np.frombuffer(digest.digest(), dtype=np.uint8)}


def sealed(arrays, **changes):
    """Return the arrays with changed metadata (``...``: without that entry) and a hash that fits."""
    metadata = json.loads(arrays["metadata"].tobytes()) | changes
    return seal(arrays | {"metadata": text(**{key: value for key, value in metadata.items() if value is not ...})})
