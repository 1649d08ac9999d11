"""Which sources a kernel reaches, against Python's own parser, over the whole package."""

from __future__ import annotations

import ast
import importlib
import re

import pytest

from tailstack.kernels import sources, store

ROOT = sources.ROOT


def module_of(file: str) -> list[str]:
    parts = ["tailstack", *file.removesuffix(".py").split("/")]
    return parts[:-1] if parts[-1] == "__init__" else parts


def files_imported(file: str) -> set[str]:
    """independent: every import statement outside of functions, by the syntax tree; a name may be a module."""
    found: set[str] = set()
    waiting: list[ast.AST] = [ast.parse((ROOT / file).read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.ImportFrom):
            here = module_of(file) if file.endswith("__init__.py") else module_of(file)[:-1]
            base = here[: len(here) - node.level + 1] if node.level else []
            module = [*base, *(node.module.split(".") if node.module else [])]
            found |= {".".join([*module, alias.name]) for alias in node.names} | {".".join(module)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) and not _for_types_only(node):
            waiting += ast.iter_child_nodes(node)
    files = {file for file in sources.SOURCES if ".".join(module_of(file)) in found}
    return files - {file}


def _for_types_only(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


@pytest.mark.parametrize("file", sorted(sources.SOURCES))
def test_every_import_is_seen(file: str) -> None:
    assert files_imported(file) <= sources.imports_of(file)


def test_every_source_is_there() -> None:
    there = {path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*.py") if "__pycache__" not in path.parts}
    assert set(sources.SOURCES) == there


@pytest.mark.long
def test_a_change_of_any_source_that_a_kernel_reaches_changes_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each file in turn gets a comment: the digests that change are those of the kernels that reach it by the tree."""
    files = store.files_with_kernels()
    graph = {file: files_imported(file) for file in sources.SOURCES}

    def reached(file: str) -> set[str]:
        found, waiting = {file}, [file]
        while waiting:
            more = graph[waiting.pop()] - found - {sources.COMPILER}
            found |= more
            waiting += more
        return found

    before = {file: sources.digest_of(file) for file in files}
    reaches = {file: reached(file) for file in files}
    original = dict(sources.SOURCES)
    try:
        for changed in sorted(set().union(*reaches.values())):
            source = original[changed]
            altered = sources.SourceFile(source.content + b"# changed\n", source.modified_ns)
            monkeypatch.setattr(sources, "SOURCES", {**original, changed: altered})
            for cached in (sources.imports_of, sources.reach, sources.digest_of):
                cached.cache_clear()
            moved = {file for file in files if sources.digest_of(file) != before[file]}
            assert moved >= {file for file in files if changed in reaches[file]}, changed
    finally:
        monkeypatch.undo()
        for cached in (sources.imports_of, sources.reach, sources.digest_of):
            cached.cache_clear()


def test_every_kernel_is_kept_by_its_sources() -> None:
    """numba's own cache is nowhere in use, and numba still asks ours."""
    for file, source in sources.SOURCES.items():
        assert b"cache=True" not in source.content, file
        assert b"enable_caching" not in source.content, file
    files = store.files_with_kernels()
    decorated = re.compile(rb"^@(kernel|lane_jit|lane_entry)\b", re.MULTILINE)
    assert {file for file, source in sources.SOURCES.items() if decorated.search(source.content)} <= set(files)
    for file in files:
        importlib.import_module(".".join(module_of(file)))
    assert len(store.KERNELS) > 50
    assert {name.rpartition(".")[0].replace(".", "/") + ".py" for name in store.KERNELS} <= set(files)
    assert all(isinstance(one._cache, store.KernelStore) for one in store.KERNELS.values())


def test_a_kernel_that_was_called_came_from_the_store_or_went_there() -> None:
    import numpy as np

    from tailstack.geometry.symmetric import eigen_symmetric

    eigen_symmetric(np.eye(3))
    assert store.TRAFFIC.loaded + store.TRAFFIC.compiled > 0
    kept = [one for one in store.stored_kernels(store.writable_directory()) if one.current]
    assert "geometry.symmetric.eigen_symmetric" in {one.name for one in kept}
    assert all(one.sound for one in kept)
    assert not any(" at 0x" in one.signature for one in kept)  # an address names nothing in another process
