"""What is answered at once, as a report: Accept says so, and the report is that of the record."""

from __future__ import annotations

import httpx
import pytest
from service_scenes import check_problem, small_design

from tailstack_service.operations.rendering import MEDIA_TYPES, render


@pytest.mark.parametrize("name", ["score", "layout"])
@pytest.mark.parametrize("form", ["html", "xlsx"])
def test_accept_asks_for_the_report_of_a_record(client: httpx.Client, name: str, form: str) -> None:
    sent = {"design": small_design()}
    record = client.post(f"/v1/{name}s", json=sent)
    answer = client.post(f"/v1/{name}s", json=sent, headers={"Accept": MEDIA_TYPES[form]})
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == MEDIA_TYPES[form]
    assert answer.content == render(name, record.content, form)
    assert "sandbox" in answer.headers["content-security-policy"]


@pytest.mark.parametrize("accept", ["*/*", "application/json, text/html", "text/html;q=0, */*", "image/png"])
def test_nobody_else_is_answered_with_one(client: httpx.Client, accept: str) -> None:
    answer = client.post("/v1/scores", json={"design": small_design()}, headers={"Accept": accept})
    assert answer.json()["schema"] == "tailstack/score/1"


def test_what_has_no_report_and_what_is_refused_stay_json(client: httpx.Client) -> None:
    headers = {"Accept": "text/html"}
    answer = client.post("/v1/validations", json={"design": small_design()}, headers=headers)
    assert answer.headers["content-type"] == "application/json"
    refused = client.post("/v1/scores", json={"design": small_design(targets=[])}, headers=headers)
    check_problem(refused, 422, "invalid-design")
