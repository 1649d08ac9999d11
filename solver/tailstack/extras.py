"""What can be left out of an installation, and the command that adds it (``pip install 'tailstack[optimise]'``)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from .errors import MissingExtraError, Problem

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
    "tables": ("openpyxl", "pyarrow"),
    "mcp": ("mcp",),
}  # fmt: skip


def install_command(*extras: str) -> str:
    """What to type to have these extras."""
    return f"pip install 'tailstack[{','.join(extras)}]'"


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


def _refusal(module: str, *extras: str) -> MissingExtraError:
    what = f"this needs the Python package {module}, which is not installed here"
    return MissingExtraError(Problem("", "missing-extra", what, install_command(*extras)))


def _is_installed(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ValueError:  # sys.modules says that there is none
        return False
