"""What can be left out of an installation, and the command that adds it from where the installation came from."""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from typing import Any

from .errors import MissingExtraError, Problem
from .version import __version__

# Modules that tailstack imports and that its core does not bring, by the extra of pyproject.toml that does
MODULES_OF = {
    "optimise": ("casadi", "cvxpy"),
    "serve": (
        "fastapi", "starlette", "uvicorn", "h11", "sqlalchemy", "alembic", "pydantic_settings", "jwt",
        "prometheus_client", "httpx", "httpx_sse",
    ),
    "report": ("jinja2", "matplotlib", "cycler", "xlsxwriter"),
    "pdf": ("weasyprint",),
    "postgres": ("psycopg",),
    "dask": ("dask", "distributed", "cryptography"),
    "tables": ("pyarrow",),
    "dicom": ("pydicom",),
}  # fmt: skip


def install_command(*extras: str) -> str:
    """What to type to have these extras.

    The package is taken from where this one came from: the checkout that runs, or the folder, file or repository that
    pip noted (PEP 610, ``direct_url.json``). Only what an index delivered is asked of an index, in the same version:
    elsewhere that name may be anybody's.
    """
    from importlib.metadata import PackageNotFoundError, distribution  # late: 25 ms, of every command

    wanted = f"[{','.join(extras)}]"
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "solver" / "tailstack").is_dir() and (checkout / "pyproject.toml").is_file():
        return f"pip install -e {quote(f'{checkout}{wanted}')}"
    try:
        noted = distribution("tailstack").read_text("direct_url.json")
    except PackageNotFoundError:
        noted = None
    if noted is None:
        return f"pip install {quote(f'tailstack{wanted}=={__version__}')}"
    origin = json.loads(noted)
    url = origin["url"]
    if "vcs_info" in origin:
        url = f"{origin['vcs_info']['vcs']}+{url}@{origin['vcs_info']['commit_id']}"
    return f"pip install {quote(f'tailstack{wanted} @ {url}')}"


def missing_extras() -> tuple[str, ...]:
    """The extras of which something is not installed."""
    return tuple(extra for extra, modules in MODULES_OF.items() if not all(map(_is_installed, modules)))


def require_extras(*extras: str) -> None:
    """Raises MissingExtraError for those that are not installed, all at once."""
    missing = [extra for extra in missing_extras() if extra in extras]
    if missing:
        module = next(name for name in MODULES_OF[missing[0]] if not _is_installed(name))
        raise _refusal(module, *missing)


@contextmanager
def name_missing_extra() -> Iterator[None]:
    """Turns the failed import of a package that an extra brings into MissingExtraError; others pass as they are."""
    try:
        yield
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        for extra, modules in MODULES_OF.items():
            if module in modules:
                raise _refusal(module, extra) from error
        raise


def load_on_first_use(package: str, source: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """``__getattr__``, ``__dir__``, ``__all__`` of a package (PEP 562) whose names the stub beside its source imports.

    A name is loaded when it is first used; it raises MissingExtraError where its module needs a package which is not
    installed.
    """
    with open(f"{source}i", encoding="utf-8") as file:
        stub = ast.parse(file.read())
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    home = {alias.name: f"{'.' * node.level}{node.module}" for node in imports for alias in node.names}

    def load(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        with name_missing_extra():
            value = getattr(import_module(home[name], package), name)
        setattr(sys.modules[package], name, value)
        return value

    return load, lambda: sorted(home), sorted(home)


def _refusal(module: str, *extras: str) -> MissingExtraError:
    what = f"this needs the Python package {module}, which is not installed here"
    return MissingExtraError(Problem("", "missing-extra", what, install_command(*extras)))


def _is_installed(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ValueError:  # sys.modules says that there is none
        return False
