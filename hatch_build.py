"""Builds the compiled kernels where a C compiler is at hand; without one the package is pure Python, only slower."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCES = (
    Path("phcontrol", "_lazy_compiled.c"),
    Path("phcontrol", "mechanics", "_compiled.c"),
    Path("phcontrol", "mechanics", "_compiled_frames.c"),
    Path("phcontrol", "safety", "_compiled.c"),
    Path("phcontrol", "safety", "_compiled_program.c"),
    Path("phcontrol", "compilation", "_caller.c"),
)

HEADERS = (
    Path("phcontrol", "_arrays.h"),
    Path("phcontrol", "mechanics", "_triangular.h"),
    Path("phcontrol", "safety", "_vectors.h"),
)


class KernelsHook(BuildHookInterface):
    """Compiles the ``_compiled`` modules beside their sources, and puts them into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the extensions; a failure is said and leaves the wheel pure."""
        if self.target_name != "wheel":
            return
        try:
            libraries = compile_extensions(Path(self.root))
        except Exception as error:  # whatever a missing or broken compiler raises
            print(f"phcontrol: the kernels were not compiled ({error}); LAPACK is used instead", file=sys.stderr)
            return
        for library in libraries:
            build_data["force_include"][str(library)] = library.relative_to(self.root).as_posix()
        build_data["infer_tag"] = True
        build_data["pure_python"] = False


def compile_extensions(root: Path) -> list[Path]:
    """Compile the extensions in place and return the libraries' paths."""
    import numpy
    from setuptools import Distribution, Extension
    from setuptools.command.build_ext import build_ext

    extensions = [
        Extension(
            ".".join(source.with_suffix("").parts),
            [str(root / source)],
            depends=[str(root / header) for header in HEADERS],
            include_dirs=[numpy.get_include()],
            extra_compile_args=["-O3"],
        )
        for source in SOURCES
    ]
    command = build_ext(Distribution({"name": "phcontrol", "ext_modules": extensions}))
    command.build_lib = str(root)
    command.build_temp = str(root / "build")
    command.ensure_finalized()
    command.run()
    return [root / command.get_ext_filename(extension.name) for extension in extensions]
