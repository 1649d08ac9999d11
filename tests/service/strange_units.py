"""Units that do what real ones must not: wait, burn, raise, end their process.  Imported by computing processes.

A request is JSON: ``do`` says how its units behave, ``units`` how many there are, ``note`` a file to which each unit
appends a line when it begins, ``held`` which units behave so (the others answer; by default all behave so), ``until`` a
file: what waits or burns ends when it is there, and without one when its process is killed.  ``cost`` is what a unit
says that it took, s of CPU.

The functions with plain arguments are calls for a place to compute (``http.compute_pool``).
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

from tailstack_service.processes.task import ADVANCE, Outcome, Task

FUNCTION = f"{__name__}:perform"
LOOK_SECONDS = 0.01  # between two looks whether a file is there


def stand_still() -> None:
    """Wait for what does not come, and use nothing of the processor."""
    threading.Event().wait()


def wait_for(path: Path) -> None:
    """Return when a file is there."""
    while not path.exists():
        time.sleep(LOOK_SECONDS)


def burn(path: Path | None = None) -> None:
    """Compute until a file is there, or for ever."""
    while path is None or not path.exists():
        pass


def request(do: str = "answer", **options: Any) -> bytes:
    return json.dumps({"do": do, **options}, sort_keys=True, separators=(",", ":")).encode()


def begun(note: Path) -> list[tuple[str, int]]:
    """What has begun, by the file in which it is noted: the unit, or the look at a job, and the process."""
    lines = note.read_text().splitlines() if note.exists() else []
    return [(spec, int(pid)) for spec, _, pid in (line.rpartition(" ") for line in lines)]


def units_begun(note: Path) -> list[int]:
    """The numbers of the units that have begun."""
    return [json.loads(spec)["unit"] for spec, _ in begun(note) if spec != ADVANCE.decode()]


def perform(task: Task) -> Outcome:
    asked: dict[str, Any] = json.loads(task.request)
    began = time.process_time()
    if "note" in asked:
        with Path(asked["note"]).open("a") as file:
            file.write(f"{task.spec.decode()} {os.getpid()}\n")
    if task.spec == ADVANCE:
        wanted = asked.get("units", 1)
        if len(task.results) < wanted:
            specs = tuple(b'{"unit":%d}' % number for number in range(len(task.results), wanted))
            return Outcome(0.0, more=specs, note=f"{len(specs)} to do")
        return Outcome(time.process_time() - began, answer=answer_of(task.request, [u.result for u in task.results]))
    if "held" not in asked or json.loads(task.spec)["unit"] in asked["held"]:
        _behave(asked)
    if asked["do"] == "refuse":
        from tailstack.errors import InfeasibleError, Problem
        from tailstack_service.documents import to_json
        from tailstack_service.problems import problem_document

        error = InfeasibleError(Problem("", "no-room", "nothing fits", "allow more"))
        return Outcome(0.0, problem=to_json(problem_document(error, instance="")))
    result = hashlib.sha256(task.request + task.spec).hexdigest().encode()
    return Outcome(asked.get("cost", time.process_time() - began), result=result)


def answer_of(request_bytes: bytes, results: list[bytes]) -> bytes:
    digest = hashlib.sha256(request_bytes + b"".join(results)).hexdigest()
    return json.dumps({"digest": digest}).encode()


def expected_answer(request_bytes: bytes) -> bytes:
    """What a job of this request comes to."""
    count = json.loads(request_bytes).get("units", 1)
    results = [hashlib.sha256(request_bytes + b'{"unit":%d}' % n).hexdigest().encode() for n in range(count)]
    return answer_of(request_bytes, results)


def _behave(asked: dict[str, Any]) -> None:
    do, until = asked["do"], Path(asked["until"]) if "until" in asked else None
    if do == "die":
        os.kill(os.getpid(), asked.get("signal", signal.SIGKILL))
    elif do == "leave":
        os._exit(3)
    elif do == "raise":
        raise ArithmeticError("a defect, for the test of it")
    elif do == "wait":
        if until is None:
            stand_still()
        else:
            wait_for(until)
    elif do == "burn":
        burn(until)
    elif do == "need":
        assert asked["module"] in sys.modules
    elif do == "print":
        print("solvers print where they like")
        os.write(1, b"and not only through Python\n")
