"""Fixtures that several files use."""

from __future__ import annotations

from openapi_scenes import node_tools
from postgres import database_url, postgres_server, postgres_url

__all__ = ["database_url", "node_tools", "postgres_server", "postgres_url"]
