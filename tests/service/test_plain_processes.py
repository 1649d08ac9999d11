"""A service as it is where there is no Linux: nothing forked, no limit on memory, no end by the system."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import psutil
from openapi_scenes import ended_job
from served import served
from service_scenes import client_of

from tailstack_service.environment import PLAIN_PROCESSES
from tailstack_service.operations.example import EXAMPLE_DESIGN
from waiting import until


def children_of(process: psutil.Process) -> list[psutil.Process]:
    """All below it; none is a process that others are forked from."""
    found = process.children(recursive=True)
    assert not any("tailstack_service.processes.nursery" in each.cmdline() for each in found if each.is_running())
    return [each for each in found if "tailstack_service.processes.child" in each.cmdline()]


def lives(process: psutil.Process) -> bool:
    with suppress(psutil.NoSuchProcess):
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    return False


def test_without_what_linux_has_a_service_answers_computes_and_leaves_nothing(tmp_path: Path) -> None:
    with served(tmp_path, **{PLAIN_PROCESSES: "1"}) as service:
        process = psutil.Process(service.pid)
        with client_of(service.url) as client:
            score = client.post("/v1/scores", json={"design": EXAMPLE_DESIGN})
            assert score.status_code == 200, score.text
            body = {"design": EXAMPLE_DESIGN, "trials": 2_000, "seed": 1}
            job = client.post("/v1/verifications", json=body)
            assert job.status_code == 202, job.text
            assert ended_job(client, f"/v1/jobs/{job.json()['id']}")["state"] == "succeeded"
        computing = children_of(process)
        assert computing
        process.kill()
        until(lambda: not any(map(lives, computing)), lambda: computing)
