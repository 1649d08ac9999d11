"""Which designs a commit may change the verdict of: what a hook hands over are the files that it changes."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from tailstack.design.fiducial_files import FORMATS
from tailstack.design.loading import list_files, read_source
from tailstack.design.reading import DOCUMENTS
from tailstack.errors import Problem, TailstackError

from ..problems import RequestError
from ..schemas import TITLES
from .gate_files import find_root, resolve

TABLES = (*FORMATS, ".tsv")  # endings of files of fiducials that are nothing else
BESIDE = re.compile(r"(policy|waivers|baseline)[^/]*$", re.IGNORECASE)  # how files are called that are no designs
OF_OURS = {name.encode() for name in TITLES}  # other documents, but for a design
SCHEMA = re.compile(rb"\btailstack/(\w+)/\d")


def list_affected(changed: Sequence[str], judged_by: Iterable[str | None]) -> list[str]:
    """The designs among the changed files, and those of the repository that hang on one of them: by a file that
    they name, or all of them by the policy, the waivers or the baseline.

    Raises RequestError where Git does not say what is in the repository.
    """
    places = {resolve(name) for name in changed}
    beside = {resolve(name) for name in judged_by if name is not None}
    known = dict(_list_designs(changed))
    tables = {table for named in known.values() for table in named}
    own = [name for name in changed if resolve(name) not in beside | tables and _may_be_design(name)]
    return [*own, *(name for name, named in known.items() if named & places or places & beside)]


def _may_be_design(name: str) -> bool:
    """Whether a changed file is judged: also where it does not say what it is, as after a slip in its first line."""
    try:
        with open(name, "rb") as file:
            kinds = {*SCHEMA.findall(file.read())}
    except OSError:
        return True
    other = bool(kinds & OF_OURS) or bool(BESIDE.search(name)) or name.lower().endswith(TABLES)
    return b"design" in kinds or not other


def _list_designs(changed: Sequence[str]) -> Iterator[tuple[str, set[Path]]]:
    """The designs of the repository, as Git has them, each with the files that it names."""
    root = (find_root(resolve(changed[0])) if changed else None) or Path.cwd()
    try:
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, check=True, timeout=60)
    except (OSError, subprocess.SubprocessError) as error:
        detail = f"--changed: Git does not say what is in this repository: {error}"
        raise RequestError(Problem("", "no-repository", detail, "name the designs, without --changed")) from None
    for name in os.fsdecode(listed.stdout).split("\0"):
        if name.lower().endswith(DOCUMENTS):
            with suppress(TailstackError):  # what is damaged and was not changed is not this commit's
                data = read_source(root / name).data
                if isinstance(data, dict) and str(data.get("schema")).startswith("tailstack/design/"):
                    named = [file for file in list_files(data) if "\0" not in file]
                    yield str(root / name), {resolve(str((root / name).parent / file)) for file in named}
