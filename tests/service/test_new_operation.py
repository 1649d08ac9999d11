"""An operation is one file and one line: whoever adds them meets it at every door."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import jsonschema
import pytest
import served
import yaml
from copied_sources import copy_sources, edit, path_of, refusal, tailstack
from service_scenes import ROOT, client_of

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
def variables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a copy of the service with one module more, and one line more in the registry."""
    source = copy_sources(tmp_path_factory.mktemp("tailstack"), "service/tailstack_service")
    operations, line = source / "tailstack_service" / "operations", '    "conversion": "convert",\n'
    (operations / "spacing.py").write_text(TOY, encoding="utf-8")
    edit(operations / "registry.py", (line, line + '    "spacing": "spacing",\n'))
    return served.environment(tmp_path_factory.mktemp("jobs"), PYTHONPATH=path_of(source))


DESIGN = ROOT / "examples" / "demo.yaml"


def test_it_is_a_verb_with_a_flag_for_each_option(copy: subprocess.Popen[str], tmp_path: Path) -> None:
    assert "spacing how far apart the fiducials are" in " ".join(tailstack(copy, tmp_path, "--help").split())
    helped = tailstack(copy, tmp_path, "spacing", "--help")
    assert "--neighbours N" in helped
    assert "pairs that are listed, closest first (default 1)" in " ".join(helped.split())
    assert "\nclosest: " in tailstack(copy, tmp_path, "spacing", str(DESIGN))
    wrong = refusal(copy, tmp_path, "spacing", str(DESIGN), "--neighbours", "51")
    assert "argument --neighbours: expected 1 to 50; got 51" in wrong


def test_its_record_has_a_published_schema(copy: subprocess.Popen[str], tmp_path: Path) -> None:
    record = json.loads(tailstack(copy, tmp_path, "spacing", str(DESIGN), "--neighbours", "3", "--json"))
    schema = json.loads(tailstack(copy, tmp_path, "schema", "spacing"))
    jsonschema.validate(record, schema)
    assert len(record["distances_mm"]) == 3
    assert schema["properties"]["distances_mm"]["description"] == "Their distances, closest first, mm."


def test_its_route_is_in_the_document_with_each_option_in_body_and_query(
    copy: subprocess.Popen[str], tmp_path: Path
) -> None:
    document = json.loads(tailstack(copy, tmp_path, "openapi"))
    described = document["paths"]["/v1/spacings"]["post"]
    assert described["operationId"] == "create_spacing"
    option = document["components"]["schemas"]["SpacingRequest"]["properties"]["neighbours"]
    assert (option["maximum"], option["default"]) == (50, 1)
    assert option["description"] == "Pairs that are listed, closest first."
    (parameter,) = (each for each in described["parameters"] if each.get("name") == "neighbours")
    assert (parameter["in"], parameter["schema"]["maximum"]) == ("query", 50)
    assert "Spacing" in document["components"]["schemas"]


@pytest.mark.long
def test_over_http_it_is_a_job_whose_record_is_that_of_the_command(
    variables: dict[str, str], copy: subprocess.Popen[str], tmp_path: Path
) -> None:
    """The option comes by the query of a design in YAML, and in a body of JSON."""
    here = tailstack(copy, tmp_path, "spacing", str(DESIGN), "--neighbours", "2", "--json").rstrip("\n")
    text, header = DESIGN.read_bytes(), {"content-type": "application/yaml", "prefer": "wait=60"}
    own = {name: variables[name] for name in ("PYTHONPATH", "TAILSTACK_DATABASE")}
    with served.served(tmp_path, **own) as service, client_of(service.url) as client:
        there = client.post("/v1/spacings", params={"neighbours": 2}, content=text, headers=header)
        assert (there.status_code, there.text) == (200, here)
        (job,) = client.get("/v1/jobs", params={"kind": "spacing"}).json()["jobs"]
        assert job["state"] == "succeeded"
        page = client.get(job["links"]["report"])
        assert "The closest two fiducials are" in page.text
        body = {"design": yaml.safe_load(text), "neighbours": 3}
        assert len(client.post("/v1/spacings", json=body, headers={"prefer": "wait=60"}).json()["distances_mm"]) == 3
        refused = client.post("/v1/spacings", params={"neighbours": 99}, content=text, headers=header)
        assert refused.status_code == 422
        assert refused.json()["errors"][0]["pointer"] == "/neighbours"


def test_its_report_is_verified(copy: subprocess.Popen[str], tmp_path: Path) -> None:
    (tmp_path / "spacing.json").write_text(tailstack(copy, tmp_path, "spacing", str(DESIGN), "--json"))
    tailstack(copy, tmp_path, "report", "spacing.json")
    said = tailstack(copy, tmp_path, "report", "--verify", "spacing.html", str(DESIGN))
    assert said.endswith("verified\n")
