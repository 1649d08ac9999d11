"""The recipe of a conda package, rendered from pyproject.toml: ``python .ci/release/recipe.py`` writes it anew."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PLACE = Path(".ci", "release", "conda", "recipe.yaml")
HEAD = """\
# Rendered by .ci/release/recipe.py from pyproject.toml, for rattler-build and conda-forge; not built yet.
# The source is the sdist of a release. Address and SHA-256 are filled in when there is one (docs/releasing.md).
schema_version: 1

package:
  name: tailstack
  version: "{version}"

source:
  - url: "TO BE FILLED IN"
    sha256: "{zeros}"

build:
  number: 0
  noarch: python
  script: ${{{{ PYTHON }}}} -m pip install . --no-deps --no-build-isolation
  python:
    entry_points:
      - {command}

requirements:
  host:
    - python {python}.*
    - hatchling
    - pip
  run:
    - python {least}
{run}

tests:
  - python:
      imports: [tailstack, tailstack_service]
  - script:
      - tailstack example demo -o demo.yaml
      - tailstack validate demo.yaml

about:
  summary: "{summary}"
  license: {licence}
  license_file:
{licences}
"""


def render(root: Path) -> str:
    """The recipe of the sources below ``root``."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    ((command, target),) = project["scripts"].items()
    needs = [re.sub(r"^([A-Za-z0-9._-]+)", r"\1 ", need).rstrip() for need in project["dependencies"]]
    return HEAD.format(
        version=version_of(root),
        zeros="0" * 64,
        command=f"{command} = {target}",
        python=project["requires-python"].removeprefix(">="),
        least=project["requires-python"],
        run="\n".join(f"    - {need}" for need in needs),
        summary=project["description"],
        licence=project["license"],
        licences="\n".join(f"    - {name}" for name in licence_files(root)),
    )


def licence_files(root: Path) -> list[str]:
    """The files that ``license-files`` of pyproject.toml names, by their paths."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = [sorted(root.glob(pattern)) for pattern in project["license-files"]]
    return [path.relative_to(root).as_posix() for paths in found for path in paths]


def version_of(root: Path) -> str:
    """The version, from the one place where it is written."""
    text = (root / "solver" / "tailstack" / "version.py").read_text(encoding="utf-8")
    (version,) = re.findall(r'^__version__ = "([^"]+)"$', text, re.MULTILINE)
    return str(version)


if __name__ == "__main__":
    (ROOT / PLACE).write_text(render(ROOT), encoding="utf-8")
    sys.stdout.write(f"{PLACE}\n")
