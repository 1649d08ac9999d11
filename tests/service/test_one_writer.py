"""What a record's bytes depend on: its content alone, whoever asks for it, and not what things are called."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from typing import Any

import httpx
import pytest
from service_scenes import small_design, write_json

from tailstack import load_design, score
from tailstack_service.cli.main import main
from tailstack_service.documents import to_json
from tailstack_service.schemas import read_record
from tailstack_service.settings import Settings

NUMBERS = [1e-5, 1.5e-7, 1e16, 1e22, 5e-324, 0.1, -0.0, 100.0, 1e15]  # their texts differ between common writers
PLAIN = "plain name"
NAMES = ["NaN", "Infinity", "-Infinity of NaN", 'NaN":1e-05', "ein Näme ∞"]
CLIENT = {"settings": Settings(worker_processes=1), "worker": True}


def named(name: str) -> dict[str, Any]:
    """A design with numbers whose text differs between writers: a noise of 1e-5 px, a far corner of the room."""
    design = small_design(name=name)
    design["views"][0]["target_noise_px"] = 1e-05
    return design


def texts_of_numbers(body: bytes) -> list[str]:
    """independent: every number of a JSON text as it is written there."""
    seen: list[str] = []
    json.loads(body, parse_float=lambda text: seen.append(text), parse_int=lambda text: seen.append(text))
    return seen


@pytest.mark.parametrize("name", NAMES)
def test_a_name_does_not_decide_how_numbers_are_written(name: str) -> None:
    result = score(load_design(named(PLAIN)))
    first = result.targets[0]
    odd = replace(result, targets=(replace(first, bias_mm=(1e-5, 1e16, 1.5e-7)), *result.targets[1:]))
    renamed = replace(odd, provenance=replace(odd.provenance, design_name=name))
    one, other = to_json(odd), to_json(renamed)
    assert other == one.replace(json.dumps(PLAIN).encode(), json.dumps(name, ensure_ascii=False).encode())
    assert texts_of_numbers(one) == texts_of_numbers(other)
    assert {"1e-05", "1e+16", "1.5e-07"} <= set(texts_of_numbers(one))


def test_numbers_are_written_as_python_writes_them_and_read_back() -> None:
    result = score(load_design(small_design()))
    for number in NUMBERS:
        body = to_json(replace(result, provenance=replace(result.provenance, design_name=repr(number))))
        at = to_json(replace(result, targets=(replace(result.targets[0], mean_norm_mm=number), *result.targets[1:])))
        assert repr(number) in texts_of_numbers(at)
        assert read_record("score", at).targets[0].mean_norm_mm == number
        assert to_json(read_record("score", body)) == body
    body = to_json(replace(result, targets=(replace(result.targets[0], mean_norm_mm=3), *result.targets[1:])))
    assert b'"mean_norm_mm":3.0,' in body
    assert to_json(read_record("score", body)) == body


@pytest.mark.parametrize("name", [PLAIN, "NaN"])
@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_not_written(name: str, number: float) -> None:
    result = score(load_design(small_design(name=name)))
    with pytest.raises(ValueError, match="JSON compliant"):
        to_json(replace(result, targets=(replace(result.targets[0], mean_norm_mm=number),)))


@pytest.mark.long("plain name")
@pytest.mark.parametrize("name", [PLAIN, "NaN and Infinity"])
def test_the_command_prints_the_bytes_that_http_sends(
    client: httpx.Client, name: str, tmp_path: Any, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    """The line on stdout is the body; its end is not part of it."""
    path = str(write_json(tmp_path / "design.json", named(name)))

    def printed(*arguments: str) -> bytes:
        assert main(arguments) in (0, 1, 4)
        out = capfdbinary.readouterr().out
        assert out.endswith(b"\n")
        return out[:-1]

    sent = client.post("/v1/scores", json={"design": named(name)})
    assert sent.status_code == 200, sent.text
    assert printed("score", path, "--json") == sent.content

    body = {"design": named(name), "trials": 2000, "seed": 3}
    check = client.post("/v1/verifications", json=body, headers={"Prefer": "wait=60"})
    assert check.status_code == 200, check.text
    assert printed("verify", path, "--trials", "2000", "--seed", "3", "--json") == check.content
    sha256 = hashlib.sha256(check.content).hexdigest()
    assert check.headers["content-location"] == f"/v1/results/{sha256}"
    stored = client.get(f"/v1/results/{sha256}")
    assert stored.content == check.content
    assert stored.headers["etag"] == f'"{sha256}"'
