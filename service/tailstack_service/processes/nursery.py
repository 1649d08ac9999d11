"""The process that computing processes are forked from (Linux): ``python -m tailstack_service.processes.nursery``.

What nearly every computation needs, modules and compiled kernels, is loaded in it once; a computing process then begins
with all of it, in some milliseconds, and shares the memory.  While nobody wants a process it loads what is missing, in
steps short enough that a wish which comes in between does not wait for long: what would have to be compiled first is
compiled by a process of its own, and found in the store of kernels then.

It is told what to do by packets on its stdin, a socket, and says there what was born and how that ended.  It ends with
the process that started it, and whatever it forked ends with it.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from select import select
from typing import NamedTuple

from . import linux
from .interpreter import digest_code, make_command, make_environment

LARGEST_PACKET = 1 << 20  # an environment is some kilobytes
# A process that has just been started needs the processor for itself
WARM_UP_AFTER_SECONDS = 1.0


class Birth(NamedTuple):
    """A wish for a computing process, which comes with the descriptors of its stdin, stdout and stderr."""

    number: int
    function: str  # that it calls for each task, "package.module:function"
    code: str  # digest of the sources that it is to run
    most_bytes: int  # of memory; 0: any
    environment: dict[str, str]


class Preparation(NamedTuple):
    """A wish that a function be called in the nursery, so that what it loads is there in whatever is born later."""

    number: int
    function: str
    computations: tuple[str, ...]  # whose kernels it calls


class Born(NamedTuple):
    """Comes with a descriptor of the process (pidfd)."""

    number: int
    pid: int


class Ended(NamedTuple):
    number: int
    code: int  # as of ``subprocess.Popen``


class Prepared(NamedTuple):
    number: int
    failure: str  # a traceback; empty: none


# --- the side of those who want processes ----------------------------------------------------------


class ForkedProcess:
    """A computing process as those see it who wanted it; a small ``subprocess.Popen``."""

    def __init__(self) -> None:
        self._born: Future[int] = Future()
        self._ended: Future[int] = Future()
        self._lock = threading.Lock()
        self._descriptor = -1
        self._unwanted = False

    @property
    def pid(self) -> int | None:
        """None for one that is not there yet, or was unwanted before it was."""
        return self._born.result() if self._born.done() and self._born.exception() is None else None

    def wait_for_birth(self) -> None:
        """Raises OSError where it will never be there."""
        self._born.result()

    @property
    def returncode(self) -> int | None:
        return self._ended.result() if self._ended.done() else None

    def poll(self) -> int | None:
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code, or the signal that ended it, negative.  Raises TimeoutError."""
        return self._ended.result(timeout)

    def kill(self) -> None:
        """At once where it is born; otherwise it counts as ended, and ends when it is born."""
        with self._lock:
            self._unwanted = True
            if self._descriptor >= 0:
                with suppress(ProcessLookupError):
                    signal.pidfd_send_signal(self._descriptor, signal.SIGKILL)
                return
        self.end(-signal.SIGKILL)

    def begin(self, pid: int, descriptor: int) -> None:
        """The nursery says that it is there."""
        with self._lock:
            self._descriptor = descriptor
            if not self._unwanted:
                self._born.set_result(pid)
                return
        self.kill()

    def end(self, code: int) -> None:
        """The nursery says how it ended."""
        with self._lock:
            if self._descriptor >= 0:
                os.close(self._descriptor)
            self._descriptor = -1
            if not self._born.done():
                self._born.set_exception(ProcessLookupError("the process has not begun"))
            if not self._ended.done():
                self._ended.set_result(code)


class StartedProcess(subprocess.Popen[bytes]):
    """A computing process where none is forked: it is there when it is started."""

    def wait_for_birth(self) -> None:
        """As of one that is forked."""


class Nursery:
    """A nursery as the process sees it that started it.  Its methods may be called from any thread."""

    def __init__(self, command: list[str], environment: dict[str, str]) -> None:
        self.command, self.environment = command, environment
        self._lock = threading.Lock()
        self._count = 0
        self._processes: dict[int, ForkedProcess] = {}
        self._preparations: dict[int, Future[None]] = {}
        self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.returncode: int | None = None
        started: Future[None] = Future()
        # Linux ends a process with the *thread* that started it (PR_SET_PDEATHSIG): this one stays to listen
        threading.Thread(target=self._listen, args=(theirs, started), name="tailstack-nursery", daemon=True).start()
        started.result()

    @property
    def alive(self) -> bool:
        return self.returncode is None

    def start(self, birth: Birth, stdin: int, stdout: int) -> ForkedProcess:
        """A computing process with these descriptors, which stay the caller's; its number is given here."""
        process = ForkedProcess()
        with self._lock:
            if not self.alive:
                process.end(self.returncode or 0)
                return process
            self._count += 1
            self._processes[self._count] = process
            self._send(birth._replace(number=self._count), [stdin, stdout, 2])
        return process

    def prepare(self, function: str, computations: tuple[str, ...]) -> Future[None]:
        """Call a function of a module there, "package.module:function"; its failure is a RuntimeError.

        computations: whose kernels it calls.
        """
        prepared: Future[None] = Future()
        with self._lock:
            if not self.alive:
                prepared.set_exception(RuntimeError(f"the process to fork from ended with {self.returncode}"))
                return prepared
            self._count += 1
            self._preparations[self._count] = prepared
            self._send(Preparation(self._count, function, computations), [])
        return prepared

    def close(self) -> None:
        """It ends when what it forked has ended."""
        with suppress(OSError):
            self._line.shutdown(socket.SHUT_WR)

    def _send(self, wish: Birth | Preparation, descriptors: list[int]) -> None:
        with suppress(OSError):  # it has ended: whoever listens says so to all who wait
            socket.send_fds(self._line, [pickle.dumps(wish)], descriptors)

    def _listen(self, theirs: socket.socket, started: Future[None]) -> None:
        try:
            with theirs:
                process = subprocess.Popen(
                    self.command, stdin=theirs.fileno(), stdout=subprocess.DEVNULL, env=self.environment
                )
        except OSError as error:
            started.set_exception(error)
            return
        started.set_result(None)
        with suppress(OSError):
            while self._hear():
                pass
        self._line.close()
        code = process.wait()
        with self._lock:
            self.returncode = code
            processes, preparations = list(self._processes.values()), list(self._preparations.values())
            self._processes.clear()
            self._preparations.clear()
        for each in processes:  # what it had forked ended with it
            each.end(-signal.SIGKILL if each.pid is not None else code)
        for waiting in preparations:
            waiting.set_exception(RuntimeError(f"the process to fork from ended with {code}"))

    def _hear(self) -> bool:
        packet, descriptors, _, _ = socket.recv_fds(self._line, LARGEST_PACKET, 1)
        if not packet:
            return False
        news = pickle.loads(packet)
        with self._lock:
            process = self._processes.get(news.number)
            if isinstance(news, Ended):
                self._processes.pop(news.number)
            prepared = self._preparations.pop(news.number, None)
        if isinstance(news, Born) and process is not None:
            process.begin(news.pid, descriptors[0])
        elif isinstance(news, Ended) and process is not None:
            process.end(news.code)
        elif prepared is not None:
            if news.failure:
                prepared.set_exception(RuntimeError(news.failure))
            else:
                prepared.set_result(None)
        return True


# What libraries read when they are loaded: with another of these, processes are forked from another nursery
READ_AT_START = ("NUMBA_", "OMP_", "OPENBLAS_", "MKL_", "ARROW_", "PYTHON", "LD_", "XDG_CACHE_HOME", "HOME")
_finding = threading.Lock()
_nurseries: list[Nursery] = []  # the one of this process, if there is one
_prepared: dict[str, tuple[str, ...]] = {}  # what is called in each


def start_child(function: str, stdin: int, stdout: int, most_bytes: int = 0) -> ForkedProcess | StartedProcess:
    """A computing process (``processes.child``) that calls ``function``, and ends with this one.

    It is forked from one that has loaded what it needs (Linux), and may be there a moment later; elsewhere it is
    started by itself, and ends with the thread that starts it.  stdin, stdout: descriptors, which stay the caller's.
    most_bytes: of memory that it may take; 0: any.
    """
    if linux.HERE:
        environment = make_environment()
        birth = Birth(0, function, digest_code(), most_bytes, environment)
        return _find_nursery(environment).start(birth, stdin, stdout)
    told = (function, str(os.getpid()), digest_code(), str(most_bytes))
    command = make_command("tailstack_service.processes.child", *told)
    return StartedProcess(command, stdin=stdin, stdout=stdout, env=make_environment())


def prepare_children(function: str, computations: tuple[str, ...]) -> Future[None]:
    """Have a function called, "package.module:function", so that what it loads is there in whatever is started later.

    computations: whose kernels it calls (``tailstack.ahead``).  The failure is a RuntimeError.  Where processes are not
    forked it is done, and nothing has happened.
    """
    if not linux.HERE:
        done: Future[None] = Future()
        done.set_result(None)
        return done
    nursery = _find_nursery(make_environment())
    with _finding:
        _prepared[function] = computations
    return nursery.prepare(function, computations)


def _find_nursery(environment: dict[str, str]) -> Nursery:
    """The one of this process, or a new one where that has ended, or was started under another environment."""

    def at_start(values: dict[str, str]) -> dict[str, str]:
        return {name: value for name, value in values.items() if name.startswith(READ_AT_START)}

    with _finding:
        command = make_command("tailstack_service.processes.nursery", str(os.getpid()))
        for known in _nurseries:
            if known.alive and known.command == command and at_start(known.environment) == at_start(environment):
                return known
            known.close()
        _nurseries[:] = [Nursery(command, environment)]
        for function, computations in _prepared.items():
            _nurseries[0].prepare(function, computations)
        return _nurseries[0]


# --- the nursery itself -----------------------------------------------------------------------------


@dataclass
class Step:
    """Something that is loaded here while nobody wants a process."""

    call: Callable[[], object]
    computations: tuple[str, ...] = ()  # whose kernels it calls (``tailstack.ahead``)
    number: int | None = None  # of the wish that it answers; None: nobody waits for it
    tried: bool = False  # by a process of its own, which leaves its kernels in their store

    def would_compile(self) -> bool:
        """Whether it would take minutes, in which nobody could be forked and no end be told."""
        if self.tried or not self.computations:
            return False
        from tailstack.ahead import calls_for
        from tailstack.errors import MissingExtraError

        try:
            return any(call.file() is None for call in calls_for(self.computations))
        except (ImportError, MissingExtraError):  # whoever needs the extra says so
            return False


def main(parent: int) -> None:
    """Fork what is wanted until nobody can want anything any more, and nothing forked is left."""
    from .child import end_with, list_warm_up_steps

    # A Ctrl-C or a stop of the whole group is for the process that started it to act on
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    end_with(parent)
    line = socket.socket(fileno=os.dup(0))
    ends, told = socket.socketpair()
    for each in (ends, told):
        each.setblocking(False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)
    own = [line, ends, told]
    steps = deque(Step(call, computations) for call, computations in list_warm_up_steps())
    forked = dict[int, int]()  # numbers by pid
    scout = 0  # pid of the process that tries a step
    wanted, patience = [line, ends], WARM_UP_AFTER_SECONDS
    while line in wanted or forked:
        ready, _, _ = select(wanted, [], [], patience if steps and not scout else None)
        if not ready:
            patience = 0.0
            if steps[0].would_compile():
                scout = _fork(partial(_try, steps[0].call, os.getpid()), own)
            else:
                _take(steps.popleft(), line)
                if not steps:
                    settle()
        if ends in ready:
            with suppress(BlockingIOError):
                ends.recv(4096)
            for pid, code in _collect_ends():
                if pid == scout:
                    scout, steps[0].tried = 0, True
                elif pid in forked:
                    _tell(line, Ended(forked.pop(pid), code))
        if line in ready:
            packet, descriptors, _, _ = socket.recv_fds(line, LARGEST_PACKET, 3)
            if not packet:
                wanted.remove(line)
                steps.clear()
                continue
            wish = pickle.loads(packet)
            if isinstance(wish, Preparation):
                step = Step(partial(_load_and_call, wish.function), wish.computations, wish.number)
                steps.insert(1 if scout else 0, step)
                patience = 0.0
            else:
                while steps and not steps[0].computations:  # modules: whoever is born would import them itself
                    _take(steps.popleft(), line)
                pid = _fork(partial(_compute, wish, descriptors, os.getpid()), own)
                forked[pid] = wish.number
                descriptor = os.pidfd_open(pid)
                _tell(line, Born(wish.number, pid), [descriptor])
                for opened in (*descriptors, descriptor):
                    os.close(opened)


def settle() -> None:
    """What is loaded stays: to look through it would take 0.1 s of whoever computes, and unshare its memory."""
    gc.collect()
    gc.freeze()


def _tell(line: socket.socket, news: Born | Ended | Prepared, descriptors: list[int] | None = None) -> None:
    with suppress(OSError):  # nobody listens any more
        socket.send_fds(line, [pickle.dumps(news)], descriptors or [])


def _collect_ends() -> Iterator[tuple[int, int]]:
    """Pids and codes of the processes that have ended."""
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            yield ended[0], os.waitstatus_to_exitcode(ended[1])


def _take(step: Step, line: socket.socket) -> None:
    failure = ""
    try:
        step.call()
    except Exception:  # without a wish: the task that needs it will say so
        failure = traceback.format_exc()
    if step.number is not None:
        settle()
        _tell(line, Prepared(step.number, failure))


def _load_and_call(function: str) -> None:
    from .child import load_function

    load_function(function)()


def _fork(call: Callable[[], None], own: list[socket.socket]) -> int:
    """The pid of a process that does this and nothing else; it does not return from here."""
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for each in own:
            each.close()
        call()
        code = 0
    except SystemExit as leaving:
        code = leaving.code if isinstance(leaving.code, int) else 1
    except BaseException:
        traceback.print_exc()
    os._exit(code)


def _try(call: Callable[[], object], nursery: int) -> None:
    from .child import end_with

    end_with(nursery)
    with suppress(Exception):  # it is called again where its failure is told
        call()


def _compute(wish: Birth, descriptors: list[int], nursery: int) -> None:
    """Be the computing process that is wanted."""
    from .child import main as compute

    for target, descriptor in enumerate(descriptors):
        os.dup2(descriptor, target)
        os.close(descriptor)
    os.environ.clear()
    os.environ.update(wish.environment)
    compute(wish.function, nursery, wish.code, wish.most_bytes)


if __name__ == "__main__":
    from tailstack_service.processes import nursery  # under the name by which packets name their types

    nursery.main(int(sys.argv[1]))
