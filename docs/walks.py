"""Two walks through the code, drawn from a run: ``python docs/walks.py`` writes them into docs/architecture.md.

Each walk is run for real, a request to the application and a command, under a profile function that notes a module
when one of its functions is first called, and the module that called it.  What a compiled function calls is found in
its globals, because no profile function sees it.  Importing a module is not entering it.  ``--check [NAME]``
writes nothing and fails when the page differs.
"""

from __future__ import annotations

import asyncio
import inspect
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "architecture.md"
DEMO = ROOT / "examples" / "demo.yaml"
NOTES = "WALK_NOTES"  # environment variable: the file that every process of a walk appends to
REMEDY = "run docs/walks.py with the environment's Python, look at what changed, and commit it"
FILES = {
    str(file): ".".join(file.relative_to(ROOT / part).with_suffix("").parts).removesuffix(".__init__")
    for part in ("solver", "service")
    for file in sorted((ROOT / part).rglob("*.py"))
}
KERNELS = "tailstack.kernels.store"
SENDER, RECEIVER = "tailstack_service.processes.pool", "tailstack_service.processes.child"
# Function whose return is the end of a walk: P95 is known; the text is written
ENDS = {
    "score": ("tailstack.tail.declared", "quantile"),
    "command": ("tailstack_service.console.command_line", "write_out"),
}

# --- noting -----------------------------------------------------------------------------------------------


class Walker(threading.local):
    """A profile function that notes each module once, until the function returns that ends the walk."""

    def __init__(self, end: tuple[str, str]) -> None:
        self.end = end
        self.passing = 0  # depth of imports, which are passed without looking inside

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        module = FILES.get(code.co_filename)
        if event == "call" and not self.passing and module and code.co_name != "<module>":
            note(module, caller_of(frame))
        elif event == "return" and not self.passing and (module, code.co_name) == self.end:
            note("end", "")
        if code.co_name == "<module>":
            self.passing += (event == "call") - (event == "return")


MET: set[str] = set()


def note(module: str, caller: str) -> None:
    """Write down a module that is met for the first time in this process."""
    if module not in MET:
        MET.add(module)
        with open(os.environ[NOTES], "a", encoding="utf-8") as notes:
            notes.write(f"{time.monotonic_ns()} {module} {caller}\n")


def caller_of(frame: FrameType | None) -> str:
    """The module of ours that called, over whatever libraries and threads lie between."""
    own = None if frame is None else frame.f_code.co_filename
    while frame is not None and (frame.f_code.co_filename == own or frame.f_code.co_filename not in FILES):
        frame = frame.f_back
    return STARTERS.get(threading.get_ident(), "") if frame is None else FILES[frame.f_code.co_filename]


STARTERS: dict[int | None, str] = {}  # by thread: the module of ours that started it


class Thread(threading.Thread):
    """A thread that knows who started it, before it does anything."""

    def start(self) -> None:
        starter, run = caller_of(inspect.currentframe()), self.run

        def run_as_started() -> None:
            STARTERS[threading.get_ident()] = starter
            run()

        self.run = run_as_started  # type: ignore[method-assign]
        super().start()


def note_kernels() -> None:
    """Have numba tell which compiled functions are called: each asks for its machine code at its first call.

    Nothing is noted while it is compiled or loaded, which may take a minute and would take several under a profile.
    """
    from numba.core.dispatcher import Dispatcher

    compile_function = Dispatcher.compile

    def compile_unnoticed(dispatcher: Any, signature: Any) -> Any:
        profile = sys.getprofile()
        if profile is None:
            return compile_function(dispatcher, signature)
        caller = caller_of(inspect.currentframe())
        note(KERNELS, caller)
        note_kernel(dispatcher.py_func, caller)
        sys.setprofile(None)
        try:
            return compile_function(dispatcher, signature)
        finally:
            sys.setprofile(profile)

    Dispatcher.compile = compile_unnoticed


def note_kernel(function: Any, caller: str) -> None:
    """Write down the modules of a compiled function and of the compiled functions that it calls."""
    waiting, met = [(function, caller)], set()
    while waiting:
        function, caller = waiting.pop(0)
        if function not in met:
            met.add(function)
            note(function.__module__, caller)
            words = (function.__globals__.get(word) for word in function.__code__.co_names)
            waiting += [(each.py_func, function.__module__) for each in words if hasattr(each, "py_func")]


def begin(walk: str) -> None:
    """Note what is called from now on, in this thread and in new ones."""
    walker = Walker(ENDS[walk])
    threading.Thread = Thread  # type: ignore[misc]
    threading.setprofile(walker)
    sys.setprofile(walker)


# --- walking ----------------------------------------------------------------------------------------------


def score() -> None:
    """POST /v1/scores to the application here, and a computing process of its own."""
    import httpx

    from tailstack_service.http import compute_pool
    from tailstack_service.http.app import create_app
    from tailstack_service.settings import Settings

    compute_pool.PERFORM = "walks:perform"
    app = create_app(Settings(database="sqlite://", max_seconds=600), warm_up=False)

    async def post() -> httpx.Response:
        yaml = {"content-type": "application/yaml"}
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client:
            begin("score")
            answer = await client.post("/v1/scores", content=DEMO.read_bytes(), headers=yaml)
            sys.setprofile(None)
            await app.state.service.pool.close()
            return answer

    answer = asyncio.run(post())
    assert answer.status_code == 200, answer.text


def perform(call: Any) -> Any:
    """What the computing process calls in place of ``perform.perform_call``."""
    from tailstack_service.operations import perform as performing
    from tailstack_service.processes.task import Estimated

    note(RECEIVER, SENDER)
    note_kernels()
    begin("score")
    try:
        found = performing.perform_call(call)
        return found.compute() if isinstance(found, Estimated) else found  # read, and on from there
    finally:
        sys.setprofile(None)


def command() -> None:
    """tailstack score DESIGN."""
    from tailstack_service.cli.main import main

    note_kernels()
    begin("command")
    code = main(["score", str(DEMO)])
    sys.setprofile(None)
    assert code in (0, 1), code  # the demo fails its limit


def walk(name: str) -> list[tuple[str, str]]:
    """The modules of a walk with their callers, in the order in which they were met."""
    with TemporaryDirectory() as folder:
        notes = Path(folder) / "notes"
        path = os.pathsep.join(
            str(ROOT / part) for part in ("solver", "service")
        )  # these sources, whatever is installed
        done = subprocess.run(
            [sys.executable, __file__, "--walk", name],
            env={**os.environ, NOTES: str(notes), "PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        noted = [line.split(" ") for line in notes.read_text(encoding="utf-8").splitlines()]
    callers: dict[str, str] = {}
    for _, module, caller in sorted(noted, key=lambda line: int(line[0])):  # nanoseconds, not their digits
        if module == "end":
            return list(callers.items())
        callers.setdefault(module, caller)
    raise AssertionError(f"{'.'.join(ENDS[name])} never returned: where does this walk end now?")


# --- drawing ----------------------------------------------------------------------------------------------


def draw(steps: list[tuple[str, str]], known: set[str]) -> str:
    """The modules as a tree: each stands once, below the one that first called it.

    Where a module and all below it are known from the walk before, it stands for all of them.
    """
    below: dict[str, list[str]] = {}
    for module, caller in steps:
        below.setdefault(caller, []).append(module)
    lines, met = list[str](), 0

    def list_below(module: str) -> list[str]:
        return [module, *(each for child in below.get(module, ()) for each in list_below(child))]

    def add(module: str, depth: int) -> None:
        nonlocal met
        under = list_below(module)
        short = len(under) > 1 and {path_of(each) for each in under} <= known
        met += len(under) if short else 1
        lines.append(f"{'  ' * depth}{path_of(module)}{f' and {len(under) - 1} below it, as above' if short else ''}")
        for each in () if short else below.get(module, ()):
            add(each, depth + 1)

    for module in below[""]:
        add(module, 0)
    assert met == len(steps), "a module was called by one that is not in the walk"
    passed = len(below) - 1
    counts = f"{met} modules: {passed} hand the work on to others, {met - passed} answer alone."
    return "```\n" + "\n".join(lines) + f"\n```\n\n{counts}\n"


def path_of(module: str) -> str:
    """The place of a module below its package, with slashes."""
    return module.partition(".")[2].replace(".", "/") or module


def drawn(page: str, name: str) -> str:
    """The page with a walk as it is now."""
    first, last = f"<!-- walk: {name} -->\n", "<!-- end of the walk -->\n"
    before, _, rest = page.partition(first)
    _, found, after = rest.partition(last)
    assert found, f"docs/architecture.md has no place for the walk {name!r}"
    known = {line.strip() for line in before.splitlines() if line.startswith(("  ", "http/"))}  # of the walk before
    return f"{before}{first}\n{draw(walk(name), known)}\n{last}{after}"


def main(arguments: list[str]) -> str | None:
    """Draw; what was found to differ, if that was the question."""
    page = PAGE.read_text(encoding="utf-8")
    if arguments[:1] == ["--check"]:
        stale = [name for name in arguments[1:] or ENDS if drawn(page, name) != page]
        return (
            f"the code no longer walks as docs/architecture.md says ({', '.join(stale)}): {REMEDY}" if stale else None
        )
    for name in ENDS:
        page = drawn(page, name)
    PAGE.write_text(page, encoding="utf-8")
    return None


if __name__ == "__main__":
    if sys.argv[1:2] == ["--walk"]:
        if hasattr(os, "sched_setaffinity"):  # one thread at a time, so that it is the same one who comes first
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        {"score": score, "command": command}[sys.argv[2]]()
    else:
        sys.exit(main(sys.argv[1:]))
