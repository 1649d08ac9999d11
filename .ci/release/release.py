"""./run release --dry-run: everything that a release consists of, built here, tried and built again; nothing is sent.

usage: ./run release --dry-run [-o DIR] [--kernels all|score|none] [--offline]

The sources are copied to a folder of their own, with the version that CHANGELOG.md says is next; this checkout stays
as it is.  Publishing is the workflow's, for a tag (docs/releasing.md).
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import tomllib
import zipfile
from datetime import UTC, datetime
from email.parser import Parser
from pathlib import Path

import changelog
import sbom
from tailstack.results.json_text import write_json

ROOT = Path(__file__).resolve().parents[2]
OTHERS = ("kernels of the other minor versions of Python (3.11 to 3.13): .github/workflows/wheels.yml builds them",)
FEW = ("score",)  # kernels of one computation, for who wants to see the steps
TRY = """
import json, sys
import tailstack, tailstack_service
from tailstack_service.cli.main import main
assert tailstack.__version__ == sys.argv[1], (tailstack.__version__, tailstack.__file__)
assert "site-packages" in tailstack.__file__, tailstack.__file__
sys.exit(main(["score", sys.argv[2]]))
"""


class Refusal(Exception):
    """What keeps the release from being one, for whoever makes it."""


def run(*command: object, cwd: Path = ROOT, **variables: str) -> str:
    """The command's stdout.  Raises Refusal with its last words where it fails."""
    done = subprocess.run(
        [str(word) for word in command], cwd=cwd, env={**os.environ, **variables}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    if done.returncode:
        raise Refusal(
            f"{' '.join(map(str, command[:6]))}: exit code {done.returncode}\n{(done.stdout + done.stderr)[-2000:]}"
        )
    return done.stdout


def say(words: str) -> None:
    print(f"release: {words}", flush=True)


# --- sources ------------------------------------------------------------------------------------------------


def moment_of(root: Path) -> int:
    """Seconds since 1970 of the last commit, by which everything is dated."""
    return int(run("git", "log", "-1", "--format=%ct", cwd=root))


def files_of(root: Path) -> list[str]:
    """What git keeps, or would: everything but what is ignored."""
    listed = run("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", cwd=root).split("\0")
    return sorted({name for name in listed if name and (root / name).is_file()})


def copy_sources(root: Path, names: list[str], target: Path) -> Path:
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(root / name, target / name)
    return target


def set_version(root: Path, version: str) -> None:
    """Write the version where it is kept, and into the file that repeats it."""
    replace(root / "solver" / "tailstack" / "version.py", r'^__version__ = ".*"$', f'__version__ = "{version}"')
    replace(root / "CITATION.cff", r"^version: .*$", f"version: {version}")


def version_of(root: Path) -> str:
    """The version, from the one place where it is written."""
    text = (root / "solver" / "tailstack" / "version.py").read_text(encoding="utf-8")
    (version,) = re.findall(r'^__version__ = "([^"]+)"$', text, re.MULTILINE)
    return str(version)


def licence_files(root: Path) -> list[str]:
    """The files that ``license-files`` of pyproject.toml names, by their paths."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = [sorted(root.glob(pattern)) for pattern in project["license-files"]]
    return [path.relative_to(root).as_posix() for paths in found for path in paths]


def replace(path: Path, pattern: str, by: str) -> None:
    text, count = re.subn(pattern, by, path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    if count != 1:
        raise Refusal(f"{path.name}: {count} lines like {pattern}")
    path.write_text(text, encoding="utf-8")


def prepare(root: Path, names: list[str], target: Path, moment: int) -> Path:
    """A copy of the sources with the next version and its section of the changelog dated."""
    copy_sources(root, names, target)
    page = target / "CHANGELOG.md"
    text = page.read_text(encoding="utf-8")
    set_version(target, changelog.next_section(text).version)
    day = datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%d")
    page.write_text(changelog.cut(text, day), encoding="utf-8")
    return target


# --- building -----------------------------------------------------------------------------------------------


def build(tree: Path, target: Path, moment: int, kernels: str, sdist: bool = True) -> None:
    """The distributions of a copy of the sources: sdist and wheel of tailstack, wheels of kernels."""
    variables = {
        "SOURCE_DATE_EPOCH": str(moment),
        "TAILSTACK_RELEASE": "1",
        "PYTHONPATH": str(tree / "solver"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    kinds = ("-t", "sdist", "-t", "wheel") if sdist else ("-t", "wheel")
    run(sys.executable, "-m", "hatchling", "build", *kinds, "-d", target.resolve(), cwd=tree, **variables)
    script = tree / "solver" / "kernels_wheel" / "build.py"
    run(sys.executable, script, "-o", target, "--empty", cwd=tree, **variables)
    if kernels != "none":
        only = ("--only", kernels) if kernels in FEW else ()
        run(sys.executable, script, "-o", target, *only, cwd=tree, **variables)


def digests(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


def unpack(sdist: Path, target: Path) -> Path:
    with tarfile.open(sdist) as archive:
        archive.extractall(target, filter="data")
    (inside,) = target.iterdir()
    return inside


def check_same(first: dict[str, str], second: dict[str, str]) -> None:
    """Raises Refusal where a file of the second folder is another one in the first."""
    if other := [name for name, digest in second.items() if first.get(name) != digest]:
        raise Refusal(f"built twice, not the same: {', '.join(other)}")


def check_licences(tree: Path, wheel: Path) -> list[str]:
    """The licences that the wheel of tailstack brings.  Raises Refusal where one of what is bundled is missing."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (about,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(about).decode())
    room = about.removesuffix("METADATA") + "licenses/"
    shipped = sorted(name.removeprefix(room) for name in names if name.startswith(room))
    wanted = licence_files(tree)
    if missing := sorted(set(wanted) - set(shipped)) + sorted(set(wanted) - set(metadata.get_all("License-File", []))):
        raise Refusal(f"{wheel.name} lacks licences: {', '.join(missing)}")
    return shipped


# --- trying -------------------------------------------------------------------------------------------------


def try_out(wheels: list[Path], tree: Path, version: str, place: Path, offline: bool) -> None:
    """Install the wheels into a fresh environment, import both packages and score the demo, in a folder of its own."""
    run(sys.executable, "-m", "venv", *(["--without-pip"] if offline else []), place / "environment")
    python = place.joinpath("environment", *Path(sys.executable).parts[-2:])
    pip: tuple[object, ...] = (
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "install",
        "--disable-pip-version-check",
    )
    if offline:  # the libraries of this environment stand in for the locked ones
        packages = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
        (packages / "libraries.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    else:
        run(*pip, "--quiet", "--require-hashes", "-r", tree / "requirements-core.lock")
    run(*pip, "--quiet", "--no-deps", "--no-index", "--ignore-installed", *wheels)
    shutil.copy(tree / "examples" / "demo.yaml", place / "design.yaml")
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "TAILSTACK_"))}
    done = subprocess.run(
        [str(python), "-c", TRY, version, "design.yaml"], cwd=place, env=clean, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    if done.returncode != 1 or "misses tip-accuracy" not in " ".join(done.stdout.split()):
        raise Refusal(f"the installed wheels do not score the demo ({done.returncode}):\n{done.stdout}{done.stderr}")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="./run release", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--dry-run", action="store_true", required=True, help="build and try; nothing is sent")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "out" / "release", metavar="DIR")
    parser.add_argument("--kernels", choices=("all", *FEW, "none"), default="all", help="which are compiled (all)")
    parser.add_argument("--offline", action="store_true", help="try with the libraries of this environment")
    given = parser.parse_args(arguments)
    try:
        release(given.output.resolve(), given.kernels, given.offline)
    except (Refusal, LookupError) as refusal:
        print(f"release: {refusal}", file=sys.stderr)
        return 1
    return 0


def release(target: Path, kernels: str, offline: bool) -> None:
    """Fill the folder with what belongs to the next version, each step said."""
    moment, names = moment_of(ROOT), files_of(ROOT)
    if target.exists() and any(target.iterdir()):
        if not (target / "SHA256SUMS").exists():
            raise Refusal(f"{target} holds other things than a release; name another folder")
        shutil.rmtree(target)
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="tailstack-release-") as temporary:
        room = Path(temporary)
        tree = prepare(ROOT, names, room / "sources", moment)
        version = version_of(tree)
        say(f"{version} (this checkout is {version_of(ROOT)}), of {len(names)} files, SOURCE_DATE_EPOCH={moment}")
        section = changelog.sections((tree / "CHANGELOG.md").read_text(encoding="utf-8"))[0]
        build(tree, target, moment, kernels)
        first = digests(target)
        say(f"built {', '.join(first)}")
        # Again: the sdist from another copy, the wheels from the sdist
        again = prepare(ROOT, names, room / "again", moment)
        build(again, room / "twice", moment, kernels)
        check_same(first, digests(room / "twice"))
        (sdist,) = target.glob("*.tar.gz")
        build(unpack(sdist, room / "unpacked"), room / "from-sdist", moment, "none", sdist=False)
        check_same(first, digests(room / "from-sdist"))
        say("built again in another folder, and from the sdist: the same to the last byte")
        (wheel,) = target.glob("tailstack-*.whl")
        say(f"licences in the wheel: {', '.join(check_licences(tree, wheel))}")
        (room / "try").mkdir()
        # Of the two wheels of kernels an installer takes the one with kernels, which is the higher version
        chosen = max(target.glob("tailstack_kernels-*.whl"), key=lambda path: ".post" in path.name)
        try_out([wheel, chosen], tree, version, room / "try", offline)
        say("installed into a fresh environment: both packages are imported, the demo is scored")
        (target / f"tailstack-{version}.cdx.json").write_text(
            write_json(sbom.bill(tree, version, moment)) + "\n", encoding="utf-8"
        )
        (target / "tag.txt").write_text(changelog.tag_text(section), encoding="utf-8")
        (target / "notes.md").write_text(
            f"# tailstack {version}\n\n## {changelog.MUST}\n\n{section.part(changelog.MUST)}\n\n"
            f"## {changelog.NEW}\n\n{section.part(changelog.NEW)}\n",
            encoding="utf-8",
        )
    sums = "".join(f"{digest}  {name}\n" for name, digest in digests(target).items())
    (target / "SHA256SUMS").write_text(sums, encoding="utf-8")
    say(f"bill of materials, text of the tag, notes and checksums are beside them in {target}")
    for other in OTHERS:
        say(f"not built here: {other}")
    say(f"nothing was sent. To release: set the version to {version}, commit, then git tag -a v{version} -F tag.txt")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
