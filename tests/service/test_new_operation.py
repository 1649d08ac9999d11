"""An operation is one file and one line: whoever adds them meets it at every door."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import jsonschema
import pytest
import served
from service_scenes import ROOT, client_of, copy_with_toy

from family import COMMAND, run_python

TOY = '''"""How far apart the fiducials are."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import dist
from typing import Annotated, Any, Literal

from pydantic import Field

from tailstack.results import Provenance

from .operation import Call, Operation, Options


class SpacingOptions(Options):
    """Which pairs count."""

    neighbours: Annotated[int, Field(ge=1, le=50)] = Field(1, description="Pairs that are listed, closest first.")


@dataclass(frozen=True, slots=True)
class Spacing:
    """The closest pairs of fiducials."""

    schema: Literal["tailstack/spacing/1"]
    """Name and version of this record's schema."""
    neighbours: int
    """Pairs that were asked for."""
    distances_mm: tuple[float, ...]
    """Their distances, closest first, mm."""
    provenance: Provenance
    """What was computed from what, and what it does not include."""


def _measure(call: Call) -> Spacing:
    from tailstack.scoring import score

    points = [point.position_mm for point in call.design.document.fiducials.points]
    distances = sorted(dist(*pair) for pair in combinations(points, 2))
    record = score(call.design)
    return Spacing("tailstack/spacing/1", call.options.neighbours, tuple(distances[: call.options.neighbours]),
                   record.provenance)


def _document(record: Spacing, sha256: str) -> Any:
    from ..rendering.document import Document, KeyNumber, Paragraph, closing_sections, provenance_facts

    closest = f"{record.distances_mm[0]:.3f} mm"
    return Document(
        kind="Spacing", title=record.provenance.design_name, tone="neutral", status="spacing",
        sentence=f"The closest two fiducials are {closest} apart.", numbers=(KeyNumber("Closest", closest),),
        matters=(), figures=(), requirements=None,
        sections=closing_sections(record.provenance, Paragraph("Nothing else.")),
        provenance=provenance_facts(record.provenance, sha256, record.schema), opening=(f"closest: {closest}",),
    )


OPERATION = Operation(
    name="spacing",
    verb="spacing",
    path="/v1/spacings",
    summary="How far apart the fiducials are",
    description="Distances of the closest pairs of fiducials.",
    title="answer of spacing: distances of the closest pairs of fiducials",
    options=SpacingOptions,
    example={"neighbours": 2},
    record=lambda: Spacing,
    run=_measure,
    document=_document,
)
'''


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The service's sources with one module more, and one line more in the registry."""
    line = '    "conversion": "convert",\n'
    return copy_with_toy(
        ROOT / "service" / "tailstack_service", tmp_path_factory.mktemp("service"), "operations/spacing.py", TOY,
        "operations/registry.py", (line, line + '    "spacing": "spacing",\n'),
    )  # fmt: skip


@pytest.fixture(scope="module")
def variables(source: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    path = os.pathsep.join([str(ROOT / "solver"), str(source)])
    return served.environment(tmp_path_factory.mktemp("jobs"), PYTHONPATH=path)


@pytest.fixture(scope="module")
def url(variables: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    own = {name: variables[name] for name in ("PYTHONPATH", "TAILSTACK_DATABASE")}
    with served.served(tmp_path_factory.mktemp("serve"), **own) as service:
        yield service.url


DESIGN = ROOT / "examples" / "demo.yaml"


def tailstack(variables: dict[str, str], *arguments: str, folder: Path | None = None) -> str:
    done = run_python(*COMMAND, *arguments, env=variables, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.long
def test_it_is_a_verb_with_a_flag_for_each_option(variables: dict[str, str]) -> None:
    assert "spacing how far apart the fiducials are" in " ".join(tailstack(variables, "--help").split())
    helped = tailstack(variables, "spacing", "--help")
    assert "--neighbours N" in helped
    assert "pairs that are listed, closest first (default 1)" in " ".join(helped.split())
    assert "\nclosest: " in tailstack(variables, "spacing", str(DESIGN))


@pytest.mark.long
def test_its_record_has_a_published_schema(variables: dict[str, str]) -> None:
    record = json.loads(tailstack(variables, "spacing", str(DESIGN), "--neighbours", "3", "--json"))
    schema = json.loads(tailstack(variables, "schema", "spacing"))
    jsonschema.validate(record, schema)
    assert len(record["distances_mm"]) == 3
    assert schema["properties"]["distances_mm"]["description"] == "Their distances, closest first, mm."


@pytest.mark.long
def test_its_route_is_in_the_document(variables: dict[str, str]) -> None:
    document = json.loads(tailstack(variables, "openapi"))
    described = document["paths"]["/v1/spacings"]["post"]
    assert described["operationId"] == "create_spacing"
    assert document["components"]["schemas"]["SpacingRequest"]["properties"]["neighbours"]["maximum"] == 50
    assert "Spacing" in document["components"]["schemas"]


@pytest.mark.long
def test_over_http_it_is_a_job_whose_record_is_that_of_the_command(url: str, variables: dict[str, str]) -> None:
    here = tailstack(variables, "spacing", str(DESIGN), "--neighbours", "2", "--json").rstrip("\n")
    yaml, header = DESIGN.read_bytes(), {"content-type": "application/yaml", "prefer": "wait=60"}
    with client_of(url) as client:
        there = client.post("/v1/spacings", params={"neighbours": 2}, content=yaml, headers=header)
        assert (there.status_code, there.text) == (200, here)
        (job,) = client.get("/v1/jobs", params={"kind": "spacing"}).json()["jobs"]
        assert job["state"] == "succeeded"
        page = client.get(job["links"]["report"])
        assert "The closest two fiducials are" in page.text
        refused = client.post("/v1/spacings", params={"neighbours": 99}, content=yaml, headers=header)
        assert refused.status_code == 422
        assert refused.json()["errors"][0]["pointer"] == "/neighbours"


@pytest.mark.long
def test_its_report_is_verified(variables: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "spacing.json").write_text(tailstack(variables, "spacing", str(DESIGN), "--json"))
    tailstack(variables, "report", "spacing.json", folder=tmp_path)
    said = tailstack(variables, "report", "--verify", "spacing.html", str(DESIGN), folder=tmp_path)
    assert said.endswith("verified\n")
