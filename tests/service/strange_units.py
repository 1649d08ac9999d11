"""Units that do what real ones must not: sleep, burn, raise, end their process.  Imported by computing processes.

A request is JSON: ``do`` says how its units behave, ``units`` how many there are, ``seconds`` how long they take,
``note`` a file to which each unit appends a line when it begins, ``gate`` a file that those wait for that hold.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import time
from pathlib import Path
from typing import Any

from tailstack_service.task import ADVANCE, Outcome, Task

FUNCTION = f"{__name__}:perform"


def request(do: str = "answer", **options: Any) -> bytes:
    return json.dumps({"do": do, **options}, sort_keys=True, separators=(",", ":")).encode()


def perform(task: Task) -> Outcome:
    asked: dict[str, Any] = json.loads(task.request)
    begun = time.process_time()
    if "note" in asked:
        with Path(asked["note"]).open("a") as file:
            file.write(f"{task.spec.decode()} {os.getpid()}\n")
    if task.spec == ADVANCE:
        wanted = asked.get("units", 1)
        if len(task.results) < wanted:
            specs = tuple(b'{"unit":%d}' % number for number in range(len(task.results), wanted))
            return Outcome(0.0, more=specs, note=f"{len(specs)} to do")
        return Outcome(time.process_time() - begun, answer=answer_of(task.request, [u.result for u in task.results]))
    _behave(asked)
    if asked["do"] == "refuse":
        from tailstack.errors import InfeasibleError, Problem
        from tailstack_service.documents import to_json
        from tailstack_service.problems import problem_document

        error = InfeasibleError(Problem("", "no-room", "nothing fits", "allow more"))
        return Outcome(0.0, problem=to_json(problem_document(error, instance="")))
    result = hashlib.sha256(task.request + task.spec).hexdigest().encode()
    return Outcome(time.process_time() - begun, result=result)


def answer_of(request_bytes: bytes, results: list[bytes]) -> bytes:
    digest = hashlib.sha256(request_bytes + b"".join(results)).hexdigest()
    return json.dumps({"digest": digest}).encode()


def expected_answer(request_bytes: bytes) -> bytes:
    """What a job of this request comes to."""
    count = json.loads(request_bytes).get("units", 1)
    results = [hashlib.sha256(request_bytes + b'{"unit":%d}' % n).hexdigest().encode() for n in range(count)]
    return answer_of(request_bytes, results)


def _behave(asked: dict[str, Any]) -> None:
    do, seconds = asked["do"], asked.get("seconds", 60.0)
    if do == "die":
        os.kill(os.getpid(), asked.get("signal", signal.SIGKILL))
    elif do == "leave":
        os._exit(3)
    elif do == "raise":
        raise ArithmeticError("a defect, for the test of it")
    elif do == "sleep":
        time.sleep(seconds)
    elif do == "hold":
        while not Path(asked["gate"]).exists():
            time.sleep(0.01)
    elif do == "burn":
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            pass
    elif do == "print":
        print("solvers print where they like")
        os.write(1, b"and not only through Python\n")
