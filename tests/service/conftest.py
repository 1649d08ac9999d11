"""Fixtures that several files use."""

from __future__ import annotations

from dask_cluster import dask_cluster
from openapi_scenes import node_tools
from postgres import database_url, postgres_server, postgres_url
from store_scenes import clock, migrated_database, migrated_file, store

__all__ = [
    "clock",
    "dask_cluster",
    "database_url",
    "migrated_database",
    "migrated_file",
    "node_tools",
    "postgres_server",
    "postgres_url",
    "store",
]
