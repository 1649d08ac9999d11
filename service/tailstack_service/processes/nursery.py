"""The process that computing processes are forked from (Linux): ``python -m tailstack_service.processes.nursery``.

What nearly every computation needs, modules and compiled kernels, is loaded in it once; a computing process then begins
with all of it, in some milliseconds, and shares the memory.  It has one thread, so that forking is safe.  While nobody
wants a process it loads what is missing, in steps short enough that a wish which comes in between does not wait for
long: what would have to be compiled first is compiled by a process of its own, and found in the store of kernels then.

Wishes come as packets on its stdin, each with a line on which it is answered (``birth``).  A process whose line is hung
up is killed.  The nursery ends when nobody is left who could wish for anything, with all that it has forked.
"""

from __future__ import annotations

import gc
import os
import pickle
import selectors
import signal
import socket
import traceback
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import NoReturn

from tailstack.errors import MissingExtraError
from tailstack.kernels.process import ignore_settings_of_folder

from . import child
from .birth import LARGEST_PACKET, PREPARED, Birth, Preparation, die_with_parent
from .task import CHECK

OPTIMISER = "tailstack.optimisation.course"
MODULES = ("numpy", "scipy.linalg", "tailstack.design", "tailstack.verification", OPTIMISER, "casadi")


@dataclass(eq=False)
class Step:
    """Something that is loaded here while nobody wants a process."""

    function: str  # that loads it, "package.module:function"
    computations: tuple[str, ...]  # whose kernels it calls (``tailstack.kernels.calls``)
    line: socket.socket | None = None  # of who waits for it
    tried: bool = False  # by a process of its own, which leaves its kernels in their store

    def would_compile(self) -> bool:
        """Whether it would take minutes, in which nobody could be forked and no end be told."""
        if self.tried:
            return False
        from tailstack.kernels.calls import calls_for

        try:
            return any(call.file() is None for call in calls_for(self.computations))
        except (ImportError, MissingExtraError):  # whoever needs the extra says so
            return False

    def attempt(self) -> None:
        with suppress(Exception):  # it is called again where its failure is told
            child.load_function(self.function)()

    def take(self) -> None:
        told = PREPARED
        try:
            child.load_function(self.function)()
        except Exception:  # where nobody waits for it the task that needs it will say so
            told = traceback.format_exc().encode()
        settle()
        if self.line is not None:
            with suppress(OSError), self.line:  # nobody listens any more
                self.line.send(told)


class Keeper:
    """What the nursery does for those who send wishes."""

    def __init__(self, wishes: socket.socket) -> None:
        self._wishes: socket.socket | None = wishes  # None: nobody is left who could send any
        self._lines: dict[int, socket.socket] = {}  # by the pid of what was forked and has not ended
        self._steps = deque([Step(CHECK, ("score", "verify"))])
        self._scouting = False  # a process tries a step
        self._selector = selectors.DefaultSelector()
        self._selector.register(wishes, selectors.EVENT_READ, self._hear)

    def go_on(self) -> None:
        """Fork what is wanted until nobody can want anything any more, and nothing forked is left."""
        for name in MODULES:  # before anything is born, which would import them itself
            with suppress(Exception):
                import_module(name)
        while self._wishes or self._lines:
            ready = self._selector.select(0 if self._steps and not self._scouting else None)
            if ready:  # one at a time: what is done for it may be the end of another
                ready[0][0].data()
            else:
                self._load()

    def _load(self) -> None:
        step = self._steps[0]
        if step.would_compile():
            self._scouting = step.tried = True
            self._fork(step.attempt, None)
        else:
            self._steps.popleft().take()

    def _hear(self) -> None:
        assert self._wishes is not None
        packet, descriptors, _, _ = socket.recv_fds(self._wishes, LARGEST_PACKET, 3)
        if not packet:
            self._selector.unregister(self._wishes)
            self._wishes = None
            self._steps.clear()
            return
        wish, line = pickle.loads(packet), socket.socket(fileno=descriptors[0])
        if isinstance(wish, Preparation):
            self._steps.insert(1 if self._scouting else 0, Step(wish.function, wish.computations, line))
            return
        self._fork(partial(_compute, wish, *descriptors[1:]), line)
        for descriptor in descriptors[1:]:
            os.close(descriptor)

    def _fork(self, call: Callable[[], None], line: socket.socket | None) -> None:
        """Have a process do this and nothing else.  line: of who wants it; None: it tries a step."""
        nursery, pid = os.getpid(), os.fork()
        if not pid:
            self._be_born(call, nursery, line)
        ended = os.pidfd_open(pid)
        self._selector.register(ended, selectors.EVENT_READ, partial(self._tell_end, pid, ended))
        if line is not None:
            self._lines[pid] = line
            self._selector.register(line, selectors.EVENT_READ, partial(self._kill, pid))

    def _be_born(self, call: Callable[[], None], nursery: int, line: socket.socket | None) -> NoReturn:
        code = 1
        try:
            die_with_parent()
            for each in (line, self._wishes, *self._lines.values()):
                if each is not None:
                    each.close()
            self._selector.close()
            if os.getppid() == nursery:  # otherwise that has just ended
                call()
                code = 0
        except SystemExit as leaving:
            code = leaving.code if isinstance(leaving.code, int) else 1
        except BaseException:
            traceback.print_exc()
        os._exit(code)

    def _kill(self, pid: int) -> None:
        """Nobody wants it any more; it has not been waited for, so the pid is still its."""
        self._selector.unregister(self._lines[pid])
        os.kill(pid, signal.SIGKILL)

    def _tell_end(self, pid: int, descriptor: int) -> None:
        self._selector.unregister(descriptor)
        os.close(descriptor)
        code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        line = self._lines.pop(pid, None)
        if line is None:
            self._scouting = False
            return
        with suppress(KeyError):  # it was hung up
            self._selector.unregister(line)
        with suppress(OSError), line:  # nobody listens any more
            line.send(str(code).encode())


def settle() -> None:
    """What is loaded stays: to look through it would take 0.1 s of whoever computes, and unshare its memory."""
    gc.collect()
    gc.freeze()


def _compute(wish: Birth, stream: int, errors: int) -> None:
    """Be the computing process that is wanted."""
    for target, descriptor in enumerate((stream, stream, errors)):
        os.dup2(descriptor, target)
    os.close(stream)
    os.close(errors)
    os.environ.clear()
    os.environ.update(wish.environment)
    child.main(wish.function, wish.code, wish.most_bytes)


def main() -> None:
    ignore_settings_of_folder()
    # A Ctrl-C or a stop of the whole group is for the process that started it to act on
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    wishes = socket.socket(fileno=os.dup(0))
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    Keeper(wishes).go_on()


if __name__ == "__main__":
    main()
