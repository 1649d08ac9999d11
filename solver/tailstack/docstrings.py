"""Texts of the sources under ``python -OO``, which leaves them out of what it compiles.

Published schemas, the OpenAPI document and ``--help`` say what stands in the sources below classes and modules: without
them they would be other documents.  So this package's modules are then compiled from their sources with them.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, ModuleType

PACKAGES = ("tailstack", "tailstack_service")
WITHOUT_TEXTS = 2  # the level of -OO and PYTHONOPTIMIZE=2


class _Loader(SourceFileLoader):
    """Compiles as -O does, and keeps nothing: what is kept for -OO has no texts."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        code: CodeType = compile(self.get_data(path), path, "exec", dont_inherit=True, optimize=1)
        return code


class _Finder:  # a finder by its method: importlib.abc would take every command 15 ms
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname.partition(".")[0] not in PACKAGES:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and type(spec.loader) is SourceFileLoader:
            spec.loader = _Loader(fullname, spec.loader.path)
        return spec


def keep_docstrings() -> None:
    """From now on, where the interpreter drops them."""
    if sys.flags.optimize >= WITHOUT_TEXTS and not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
