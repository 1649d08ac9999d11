"""The same input, the same bytes: whatever the hash seed, time zone, locale and number of threads."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest
from service_scenes import ROOT, limited

from family import run_process

ENVIRONMENTS = (
    {"PYTHONHASHSEED": "1", "TZ": "UTC", "LC_ALL": "C"},
    {"PYTHONHASHSEED": "2", "TZ": "Asia/Tokyo", "LC_ALL": "C.UTF-8", "NUMBA_NUM_THREADS": "1"},
)


@pytest.fixture
def written(tmp_path: Path) -> list[Path]:
    """Directories with the files of one design, written by processes that differ in what a report must not show."""
    design = tmp_path / "design.json"
    design.write_text(json.dumps(limited(0.9)), encoding="utf-8")
    folders = []
    for number, environment in enumerate(ENVIRONMENTS):
        folder = tmp_path / str(number)
        command = [sys.executable, "-m", "tailstack_service.cli.main", "report", str(design), "--trials", "4000"]
        path = os.pathsep.join([str(ROOT / "solver"), str(ROOT / "service")])
        done = run_process(
            *command,
            "--format",
            "html,pdf,xlsx,json",
            "-o",
            str(folder),
            env={**os.environ, "PYTHONPATH": path, **environment},
        )
        assert done.returncode in (0, 1, 4), done.stderr
        folders.append(folder)
    return folders


@pytest.mark.long
def test_processes_that_differ_write_the_same_bytes(written: list[Path]) -> None:
    names = [sorted(path.name for path in folder.iterdir()) for folder in written]
    assert names[0] == names[1] == ["design.html", "design.pdf", "design.report.json", "design.xlsx"]
    for name in names[0]:
        assert (written[0] / name).read_bytes() == (written[1] / name).read_bytes(), name
