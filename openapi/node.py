"""The npm tools that a ``package-lock.json`` pins, installed once per state of that file outside the checkout."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PINS = ("package.json", "package-lock.json")
SECONDS = 300
QUIET = {"REDOCLY_TELEMETRY": "off", "REDOCLY_SUPPRESS_UPDATE_NOTICE": "true", "NO_COLOR": "1", "CI": "1"}


class NodeMissing(Exception):
    """Node, npm or the npm registry is not to be had here; the message says which."""


def tools(home: Path = HERE) -> Path:
    """Directory of the installed commands that the files in ``home`` pin.  Raises NodeMissing."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        raise NodeMissing("node and npm are not on the PATH: install Node.js 20.19 or later")
    version = subprocess.run([node, "--version"], capture_output=True, text=True, timeout=60).stdout
    digest = hashlib.sha256(version.encode() + b"".join((home / name).read_bytes() for name in PINS)).hexdigest()[:16]
    place = Path(tempfile.gettempdir()) / f"tailstack-npm-{getattr(os, 'getuid', int)()}-{digest}"
    if not place.exists():
        _install(npm, place, home)
    return place / "node_modules" / ".bin"


def _install(npm: str, place: Path, home: Path) -> None:
    """``npm ci`` in a folder of its own, which is then moved to its place whole, or not at all."""
    fresh = Path(tempfile.mkdtemp(prefix="tailstack-npm-"))
    try:
        for name in PINS:
            shutil.copy(home / name, fresh)
        command = [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--no-update-notifier"]
        try:
            done = subprocess.run(command, cwd=fresh, capture_output=True, text=True, timeout=SECONDS)
        except subprocess.TimeoutExpired:
            raise NodeMissing(f"npm ci did not finish in {SECONDS} s: is the npm registry reachable?") from None
        if done.returncode:
            raise NodeMissing(f"npm ci failed: {done.stderr.strip()[-600:]}")
        try:
            fresh.rename(place)
        except OSError:  # somebody else was quicker
            if not place.exists():
                raise
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def run_script(script: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """A script of ours; its first argument is the folder of the pinned packages.  Raises NodeMissing, as ``run``."""
    return _called("node", script, tools().parent, *arguments)


def run(tool: str, *arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """One of the pinned commands, without telemetry.  Raises NodeMissing; its own failure is in the return code."""
    return _called(tools() / tool, *arguments, cwd=cwd)


def _called(*command: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*map(str, command)],
        cwd=cwd,
        env={**os.environ, **QUIET},
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
