"""Builds the compiled kernels where a C compiler is at hand; without one the package is pure Python, only slower."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCE = Path("phcontrol", "mechanics", "_compiled.c")


class KernelsHook(BuildHookInterface):
    """Compiles ``phcontrol.mechanics._compiled`` beside its source, and puts it into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the extension; a failure is said and leaves the wheel pure."""
        if self.target_name != "wheel":
            return
        try:
            library = compile_extension(Path(self.root))
        except Exception as error:  # whatever a missing or strange compiler raises
            print(f"phcontrol: the kernels were not compiled ({error}); LAPACK is used instead", file=sys.stderr)
            return
        build_data["force_include"][str(library)] = library.relative_to(self.root).as_posix()
        build_data["infer_tag"] = True
        build_data["pure_python"] = False


def compile_extension(root: Path) -> Path:
    """Compile the extension in place and return the library's path."""
    import numpy
    from setuptools import Distribution, Extension
    from setuptools.command.build_ext import build_ext

    name = ".".join(SOURCE.with_suffix("").parts)
    extension = Extension(name, [str(root / SOURCE)], include_dirs=[numpy.get_include()], extra_compile_args=["-O3"])
    command = build_ext(Distribution({"name": "phcontrol", "ext_modules": [extension]}))
    command.build_lib = str(root)
    command.build_temp = str(root / "build")
    command.ensure_finalized()
    command.run()
    return root / command.get_ext_filename(name)
