"""The process that computing processes are forked from (Linux): ``python -m tailstack_service.processes.nursery``.

What nearly every computation needs, modules and compiled kernels, is loaded in it once; a computing process then begins
with all of it, in some milliseconds, and shares the memory.  While nobody wants a process it loads what is missing, in
steps short enough that a wish which comes in between does not wait for long: what would have to be compiled first is
compiled by a process of its own, and found in the store of kernels then.

It is told what to do by packets on its stdin, a socket, and says there what was born and how that ended.  Processes
beside the one that started it, those of one service, may have lines of their own to it: nothing is then loaded twice.
What was forked for a line ends when its other end is gone.  It ends with the process that started it, and whatever it
forked ends with it.
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
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from select import POLLHUP, POLLIN, poll
from struct import Struct
from typing import NamedTuple

from tailstack.kernels.process import ignore_settings_of_folder

from . import linux
from .interpreter import digest_code, make_command, make_environment

LARGEST_PACKET = 1 << 20  # an environment is some kilobytes
LINES = 64  # that may wait to be accepted
PEER = Struct("3i")  # of SO_PEERCRED: pid, user, group
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


class Opening(NamedTuple):
    """A wish that others have lines as well; comes with the socket to accept them from."""


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
    """A nursery as a process sees it that has a line to it.  Its methods may be called from any thread."""

    def __init__(self, command: list[str], environment: dict[str, str], joined: socket.socket | None = None) -> None:
        """Start one by a command, or have a line to one that was started by another process in the same way."""
        self.command, self.environment = command, environment
        self._lock = threading.Lock()
        self._count = 0
        self._processes: dict[int, ForkedProcess] = {}
        self._preparations: dict[int, Future[None]] = {}
        self._name = ""  # under which others have lines to it
        self.returncode: int | None = None
        theirs: socket.socket | None = None
        if joined is not None:
            self._line = joined
        else:
            self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
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

    def share(self) -> str:
        """The name of a socket from which processes of this user have lines to it, as long as it is there."""
        with self._lock:
            if not self._name:
                with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as accepting:
                    accepting.bind("")  # to a free name, which is no file: NUL and digits
                    accepting.listen(LINES)
                    self._name = accepting.getsockname()[1:].decode()
                    self._send(Opening(), [accepting.fileno()])
            return self._name

    def close(self) -> None:
        """It ends when what it forked has ended."""
        with suppress(OSError):
            self._line.shutdown(socket.SHUT_WR)

    def _send(self, wish: Birth | Preparation | Opening, descriptors: list[int]) -> None:
        with suppress(OSError):  # it has ended: whoever listens says so to all who wait
            socket.send_fds(self._line, [pickle.dumps(wish)], descriptors)

    def _listen(self, theirs: socket.socket | None, started: Future[None]) -> None:
        process: subprocess.Popen[bytes] | None = None
        try:
            if theirs is not None:
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
        code = -signal.SIGHUP if process is None else process.wait()  # how another's ended only that one is told
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
MODULE = "tailstack_service.processes.nursery"
_finding = threading.Lock()
_nurseries: list[Nursery] = []  # the one of this process, if there is one
_prepared: dict[str, tuple[str, ...]] = {}  # what is called in each
_address = ""  # of the one that another process has shared, until it is asked


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

    computations: whose kernels it calls (``tailstack.kernels.calls``).  The failure is a RuntimeError.  Where processes
    are not forked it is done, and nothing has happened.
    """
    if not linux.HERE:
        done: Future[None] = Future()
        done.set_result(None)
        return done
    nursery = _find_nursery(make_environment())
    with _finding:
        _prepared[function] = computations
    return nursery.prepare(function, computations)


def share_nursery() -> str:
    """An address of the nursery of this process, for processes that it starts (``join_nursery``); empty: there is none.

    Whoever comes has to be of the same user, and to run the same code under the same environment.
    """
    if not linux.HERE:
        return ""
    environment = make_environment()
    return f"{_find_nursery(environment).share()} {_kind(environment)}"


def join_nursery(address: str) -> None:
    """Have the computing processes of this process forked from a nursery that another has shared.

    Where that cannot be, because it is gone or has loaded other code, from one of its own, as without an address.
    """
    global _address
    _address = address


def _at_start(environment: dict[str, str]) -> dict[str, str]:
    return {name: value for name, value in environment.items() if name.startswith(READ_AT_START)}


def _kind(environment: dict[str, str]) -> str:
    """What is loaded into a nursery that this process starts."""
    told = [*make_command(MODULE), digest_code(), *map(str, sorted(_at_start(environment).items()))]
    return sha256("\0".join(told).encode()).hexdigest()


def _join(command: list[str], environment: dict[str, str]) -> Nursery | None:
    """The nursery that another has shared, if there is one of the right kind; it is asked for once."""
    global _address
    address, _address = _address, ""
    name, _, kind = address.rpartition(" ")
    if not name or kind != _kind(environment):
        return None
    line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        line.connect(b"\0" + name.encode())
    except OSError:  # it has ended
        line.close()
        return None
    if not _is_ours(line):  # another user has taken the name since, who would read what is in the environment
        line.close()
        return None
    return Nursery(command, environment, line)


def _is_ours(line: socket.socket) -> bool:
    """Whether a process of this user is at the other end."""
    _, user, _ = PEER.unpack(line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, PEER.size))
    return bool(user == os.geteuid())


def _find_nursery(environment: dict[str, str]) -> Nursery:
    """The one of this process, or a new one where that has ended, or was started under another environment."""
    with _finding:
        command = make_command(MODULE, str(os.getpid()))
        for known in _nurseries:
            if known.alive and known.command == command and _at_start(known.environment) == _at_start(environment):
                return known
            known.close()
        _nurseries[:] = [_join(command, environment) or Nursery(command, environment)]
        for function, computations in _prepared.items():
            _nurseries[0].prepare(function, computations)
        return _nurseries[0]


# --- the nursery itself -----------------------------------------------------------------------------


@dataclass(eq=False)
class Line:
    """One of those who want processes."""

    socket: socket.socket
    forked: dict[int, int] = field(default_factory=dict)  # numbers by pid, of those that have not ended
    hears: bool = True  # wishes may still come

    def tell(self, news: Born | Ended | Prepared, descriptors: list[int] | None = None) -> None:
        with suppress(OSError):  # nobody listens any more
            socket.send_fds(self.socket, [pickle.dumps(news)], descriptors or [])

    def receive(self) -> tuple[Birth | Preparation | Opening | None, list[int]]:
        """The next wish and its descriptors; None: none will come."""
        try:
            packet, descriptors, _, _ = socket.recv_fds(self.socket, LARGEST_PACKET, 3)
        except OSError:  # it ended before it had read everything
            return None, []
        return (pickle.loads(packet) if packet else None), descriptors


@dataclass(eq=False)
class Step:
    """Something that is loaded here while nobody wants a process."""

    call: Callable[[], object]
    computations: tuple[str, ...] = ()  # whose kernels it calls (``tailstack.kernels.calls``)
    wish: tuple[Line, int] | None = None  # that it answers, by its number; None: nobody waits for it
    tried: bool = False  # by a process of its own, which leaves its kernels in their store

    def would_compile(self) -> bool:
        """Whether it would take minutes, in which nobody could be forked and no end be told."""
        if self.tried or not self.computations:
            return False
        from tailstack.errors import MissingExtraError
        from tailstack.kernels.calls import calls_for

        try:
            return any(call.file() is None for call in calls_for(self.computations))
        except (ImportError, MissingExtraError):  # whoever needs the extra says so
            return False

    def take(self) -> None:
        failure = ""
        try:
            self.call()
        except Exception:  # without a wish: the task that needs it will say so
            failure = traceback.format_exc()
        if self.wish is not None:
            settle()
            line, number = self.wish
            line.tell(Prepared(number, failure))


def main(parent: int) -> None:
    """Fork what is wanted until nobody can want anything any more, and nothing forked is left."""
    ignore_settings_of_folder()
    from .child import end_with, list_warm_up_steps

    # A Ctrl-C or a stop of the whole group is for the process that started it to act on
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    end_with(parent)
    _Keeper(socket.socket(fileno=os.dup(0)), list_warm_up_steps()).go_on()


class _Keeper:
    """What the nursery does for those who have lines to it."""

    def __init__(self, first: socket.socket, steps: list[tuple[Callable[[], object], tuple[str, ...]]]) -> None:
        self._polled = poll()
        self._lines: dict[int, Line] = {}  # by descriptor
        self._accepting: dict[int, socket.socket] = {}
        self._ends, self._told = socket.socketpair()
        for each in (self._ends, self._told):
            each.setblocking(False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(self._told.fileno(), warn_on_full_buffer=False)
        self._polled.register(self._ends, POLLIN)
        self._steps = deque(Step(call, computations) for call, computations in steps)
        self._scout = 0  # pid of the process that tries a step
        self._patience_seconds = WARM_UP_AFTER_SECONDS
        self._add(first)

    def go_on(self) -> None:
        while any(line.hears or line.forked for line in self._lines.values()):
            patience = 1e3 * self._patience_seconds if self._steps and not self._scout else None
            ready = self._polled.poll(patience)
            if not ready:
                self._patience_seconds = 0.0
                self._load()
            for descriptor, what in ready:
                if descriptor == self._ends.fileno():
                    self._collect()
                elif descriptor in self._accepting:
                    self._accept(self._accepting[descriptor])
                elif what & POLLIN:
                    self._hear(self._lines[descriptor])
                else:
                    self._hang_up(self._lines[descriptor])

    def _load(self) -> None:
        step = self._steps[0]
        if step.would_compile():
            self._scout = self._fork(partial(_try, step.call, os.getpid()))
            return
        self._steps.popleft().take()
        if not self._steps:
            settle()

    def _collect(self) -> None:
        with suppress(BlockingIOError):
            self._ends.recv(4096)
        for pid, code in _collect_ends():
            if pid == self._scout:
                self._scout = 0
                if self._steps:  # nobody hears any more where there is none
                    self._steps[0].tried = True
            for line in self._lines.values():
                if pid in line.forked:
                    line.tell(Ended(line.forked.pop(pid), code))

    def _add(self, line: socket.socket) -> None:
        self._lines[line.fileno()] = Line(line)
        self._polled.register(line, POLLIN)

    def _accept(self, accepting: socket.socket) -> None:
        line, _ = accepting.accept()
        if _is_ours(line):
            self._add(line)
        else:
            line.close()

    def _hear(self, line: Line) -> None:
        wish, descriptors = line.receive()
        if wish is None:
            line.hears = False
            self._polled.modify(line.socket, POLLHUP)
            if not any(each.hears for each in self._lines.values()):
                self._steps.clear()
        elif isinstance(wish, Opening):
            accepting = socket.socket(fileno=descriptors[0])
            self._accepting[accepting.fileno()] = accepting
            self._polled.register(accepting, POLLIN)
        elif isinstance(wish, Preparation):
            step = Step(partial(_load_and_call, wish.function), wish.computations, (line, wish.number))
            self._steps.insert(1 if self._scout else 0, step)
            self._patience_seconds = 0.0
        else:
            self._import()
            pid = self._fork(partial(_compute, wish, descriptors, os.getpid()))
            line.forked[pid] = wish.number
            descriptor = os.pidfd_open(pid)
            line.tell(Born(wish.number, pid), [descriptor])
            for opened in (*descriptors, descriptor):
                os.close(opened)

    def _import(self) -> None:
        """Take what imports modules, wherever it stands: whoever is born without would import them itself."""
        modules = [step for step in self._steps if not step.computations]
        self._steps = deque(step for step in self._steps if step.computations)
        for step in modules:
            step.take()

    def _hang_up(self, line: Line) -> None:
        """Its process has ended, and nobody can want anything of what was forked for it."""
        self._polled.unregister(line.socket)
        del self._lines[line.socket.fileno()]
        line.socket.close()
        for pid in line.forked:  # none has been waited for, so each pid is still that of what was forked
            os.kill(pid, signal.SIGKILL)

    def _fork(self, call: Callable[[], None]) -> int:
        """The pid of a process that does this and nothing else; it does not return from here."""
        pid = os.fork()
        if pid:
            return pid
        code = 1
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            lines = [line.socket for line in self._lines.values()]
            for each in (self._ends, self._told, *self._accepting.values(), *lines):
                each.close()
            call()
            code = 0
        except SystemExit as leaving:
            code = leaving.code if isinstance(leaving.code, int) else 1
        except BaseException:
            traceback.print_exc()
        os._exit(code)


def settle() -> None:
    """What is loaded stays: to look through it would take 0.1 s of whoever computes, and unshare its memory."""
    gc.collect()
    gc.freeze()


def _collect_ends() -> Iterator[tuple[int, int]]:
    """Pids and codes of the processes that have ended."""
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            yield ended[0], os.waitstatus_to_exitcode(ended[1])


def _load_and_call(function: str) -> None:
    from .child import load_function

    load_function(function)()


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
