"""The wheel of a release asks for compiled kernels; one that is built from a checkout does not.

The distribution of kernels of a version is on the index when that version is.  A checkout may be of any state, for
which there are none: what asked for them could then not be installed at all.
"""

from __future__ import annotations

import os
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class KernelsRequirement(BuildHookInterface[Any]):
    """Adds the requirement where ``TAILSTACK_RELEASE`` is set, as ``build.py --release`` sets it."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version != "editable" and os.environ.get("TAILSTACK_RELEASE"):
            # VERSION without kernels or VERSION.postN with them, whichever the installer can take
            build_data["dependencies"].append(f"tailstack-kernels =={self.metadata.version}.*")
