"""The engine that the settings name."""

from __future__ import annotations

from tailstack.errors import Problem

from ..problems import RequestError
from ..settings import Settings
from .engine import PERFORM, Engine


def engine_for(settings: Settings, *, function: str = PERFORM) -> Engine:
    """Raises RequestError if the engine cannot be had with these settings."""
    if settings.engine == "dask":
        try:
            from .dask import DaskEngine
        except ModuleNotFoundError as error:
            raise RequestError(
                Problem("", "no-dask", f"engine dask needs the package {error.name}", "pip install 'tailstack[dask]'")
            ) from None
        return DaskEngine(settings, function=function)
    from .pool import PoolEngine

    return PoolEngine(settings.worker_processes, function=function, hang_seconds=settings.hang_seconds)
