"""Where numba finds the image's kernels although it may not write there.

Every locator of numba gives up on a directory that is not writable, and code that cannot find a locator fails at its
import.  This one keeps its cache in ``NUMBA_CACHE_DIR`` (a tmpfs) and fills it with links to the prebuilt files, so
that these are found, and whatever is compiled in addition has a place to go.
"""

from __future__ import annotations

import os
from contextlib import suppress
from functools import cache
from pathlib import Path

from numba.core.caching import UserProvidedCacheLocator
from tailstack_kernels import PREBUILT


class Prebuilt(UserProvidedCacheLocator):
    """For ``NUMBA_CACHE_LOCATOR_CLASSES``."""

    def ensure_cache_path(self) -> None:
        """Raises RuntimeError where not even ``NUMBA_CACHE_DIR`` can be written."""
        path = Path(self.get_cache_path())
        try:
            super().ensure_cache_path()
            link_prebuilt(path, PREBUILT / path.name)
        except OSError as error:
            raise RuntimeError(f"{path} cannot be written ({error.strerror}): mount a tmpfs on /tmp") from None


@cache
def link_prebuilt(path: Path, prebuilt: Path) -> None:
    """Links in ``path`` to the files of ``prebuilt``.  Several processes may do this at once."""
    if not prebuilt.is_dir():
        return
    for file in os.listdir(prebuilt):
        with suppress(FileExistsError):
            os.symlink(prebuilt / file, path / file)
