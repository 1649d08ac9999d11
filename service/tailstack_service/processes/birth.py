"""Python processes of our own: how one is started, computing processes as whoever wants them sees them, what they say.

Each has the same interpreter and the same modules, and one thread in heavy loops.  Computing processes are forked from
a nursery (Linux), or started by themselves.

The processes of one service share the nursery of the one that started them, so that nothing is loaded twice: each holds
the socket on which wishes are sent.  With a wish goes one end of a line, a socket of its own; on the other end is told
how the process ended, and where that is hung up, by ``kill`` or by the end of whoever wanted it, it is killed.
"""

from __future__ import annotations

import asyncio
import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
import threading
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import IO, Any, NamedTuple

from tailstack.kernels import sources
from tailstack.kernels.process import SINGLE_THREADED
from tailstack.version import __file__ as _file_of_solver
from tailstack.version import __version__

from ..environment import PLAIN_PROCESSES

ON_LINUX = sys.platform == "linux" and os.environ.get(PLAIN_PROCESSES, "") in ("", "0")
LARGEST_PACKET = 1 << 20  # an environment is some kilobytes
LONGEST_CODE = 16  # digits
PREPARED = b"prepared"
NURSERY, CHILD = "tailstack_service.processes.nursery", "tailstack_service.processes.child"
# What libraries read when they are loaded: with another of these, processes are forked from another nursery
READ_AT_START = ("NUMBA_", "OMP_", "OPENBLAS_", "MKL_", "ARROW_", "PYTHON", "LD_", "XDG_CACHE_HOME", "HOME")


class Birth(NamedTuple):
    """A wish for a computing process, which comes with its line, and the descriptors of its stream and its stderr."""

    function: str  # that it calls for each task, "package.module:function"
    code: str  # digest of the sources that it is to run
    most_bytes: int  # of memory; 0: any
    environment: dict[str, str]


class Preparation(NamedTuple):
    """A wish that a function be called in the nursery, so that what it loads is there in whatever is born later.

    On its line comes ``PREPARED``, or a traceback.
    """

    function: str
    computations: tuple[str, ...]  # whose kernels it calls (``tailstack.kernels.calls``)


class ForkedProcess:
    """One that was asked for in a nursery, born or not yet; a small ``subprocess.Popen``."""

    def __init__(self, line: socket.socket) -> None:
        self._line = line

    def poll(self) -> int | None:
        with suppress(BlockingIOError):
            return self._look(socket.MSG_DONTWAIT)
        return None

    def wait(self) -> int:
        """Its exit code, or the signal that ended it, negative."""
        return self._look(0)

    def kill(self) -> None:
        with suppress(OSError):  # it has ended
            self._line.shutdown(socket.SHUT_WR)

    def __enter__(self) -> ForkedProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self._line.close()

    def _look(self, flags: int) -> int:
        """What is told stays on the line, so that all who look see it."""
        told = _peek(self._line, flags)
        return int(told) if told else -signal.SIGKILL  # the nursery has ended, and with it what it had forked


class Nursery(NamedTuple):
    """A nursery as a process sees it that may send wishes to it."""

    wishes: socket.socket
    code: str  # digest of the sources that it has loaded
    environment: dict[str, str] | None = None  # what libraries have read there; None: it was started by another process

    @staticmethod
    def read(text: str) -> Nursery:
        """One that this process was told of when it was started, with the descriptor that it inherited."""
        descriptor, _, code = text.partition(" ")
        wishes = socket.socket(fileno=int(descriptor))
        wishes.set_inheritable(False)
        return Nursery(wishes, code)

    def __str__(self) -> str:
        return f"{self.wishes.fileno()} {self.code}"

    def is_alive(self) -> bool:
        with suppress(BlockingIOError):
            return bool(_peek(self.wishes, socket.MSG_DONTWAIT))  # it says nothing there: this is the end
        return True


_finding = threading.Lock()
_nursery: Nursery | None = None  # of this process
_started: list[tuple[Nursery, subprocess.Popen[bytes]]] = []  # also those that have ended, or are about to
_prepared: dict[str, tuple[str, ...]] = {}  # what is called in each


def start_child(function: str, stream: int, most_bytes: int = 0) -> ForkedProcess | subprocess.Popen[bytes]:
    """A computing process (``processes.child``) that calls ``function``, and ends with this process.

    It is forked from one that has loaded what it needs (Linux), and may be there a moment later; elsewhere it is
    started by itself.  stream: descriptor of a socket for tasks and outcomes, which stays the caller's.  most_bytes: of
    memory that it may take; 0: any.  Raises OSError.
    """
    environment = make_environment()
    if ON_LINUX:
        return ForkedProcess(_ask(Birth(function, digest_code(), most_bytes, environment), stream, 2))
    command = make_command(CHILD, function, digest_code(), str(most_bytes))
    return subprocess.Popen(command, stdin=stream, stdout=stream, env=environment)


async def prepare_children(function: str, computations: tuple[str, ...]) -> None:
    """Have a function called, "package.module:function", so that what it loads is there in whatever is started later.

    computations: whose kernels it calls (``tailstack.kernels.calls``).  Where processes are not forked nothing happens.
    Raises RuntimeError with what failed, OSError.
    """
    if not ON_LINUX:
        return
    with _ask(Preparation(function, computations)) as line:
        _prepared[function] = computations
        line.setblocking(False)
        told = await asyncio.get_running_loop().sock_recv(line, LARGEST_PACKET)
    if told != PREPARED:
        raise RuntimeError(told.decode() or "the process to fork from has ended")


def share_nursery() -> Nursery | None:
    """The nursery of this process, for processes that it starts (``join_nursery``); None: processes are not forked.

    It goes there as multiprocessing pickles it, or by the descriptor of its socket.
    """
    return _find_nursery() if ON_LINUX else None


def join_nursery(nursery: Nursery) -> None:
    """Have the computing processes of this process forked from a nursery that the one that started it has shared.

    Where that cannot be, because it has ended or has loaded other code, they come from one of its own.
    """
    global _nursery
    if nursery.code == digest_code():
        _nursery = nursery._replace(environment=None)


def _find_nursery() -> Nursery:
    """The one of this process, or a new one where that has ended, or was started under another environment."""
    global _nursery
    environment = make_environment()
    at_start = {name: value for name, value in environment.items() if name.startswith(READ_AT_START)}
    with _finding:
        if _nursery is None or not _nursery.is_alive() or _nursery.environment not in (None, at_start):
            for nursery, process in _started:
                with suppress(OSError):  # it has ended
                    nursery.wishes.shutdown(socket.SHUT_WR)
                process.poll()
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            _nursery = Nursery(ours, digest_code(), at_start)
            with theirs:
                command = make_command(NURSERY)
                process = subprocess.Popen(command, stdin=theirs.fileno(), stdout=subprocess.DEVNULL, env=environment)
            _started.append((_nursery, process))
            for function, computations in _prepared.items():
                _send(_nursery, Preparation(function, computations)).close()
        return _nursery


def _ask(wish: Birth | Preparation, *descriptors: int) -> socket.socket:
    return _send(_find_nursery(), wish, *descriptors)


def _send(nursery: Nursery, wish: Birth | Preparation, *descriptors: int) -> socket.socket:
    """Our end of the line; the end of all that is said there where the nursery has just ended."""
    line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs, suppress(BrokenPipeError, ConnectionResetError):
        socket.send_fds(nursery.wishes, [pickle.dumps(wish)], [theirs.fileno(), *descriptors])
    return line


def _peek(line: socket.socket, flags: int) -> bytes:
    with suppress(ConnectionResetError):  # it ended before it had read everything
        return line.recv(LONGEST_CODE, socket.MSG_PEEK | flags)
    return b""


# --- messages ------------------------------------------------------------------------------------------------

# A message is a frame: its length, then a pickle.  Both ends are the same version of the same program on one host.
#
# A computing process says its pid when it is ready.  Of each task it says ``BEGUN``, then perhaps, when what was sent
# has been read, how many seconds of CPU the rest is expected to take (a float), to which the answer is whether it is to
# go on (True) or to leave it at that, then the outcome: what came of it, the traceback of a defect, whether the process
# is to be replaced, and the seconds of CPU that it took.

BEGUN = "begun"  # said by a computing process when it has taken up a task
OTHER_CODE = 78  # exit code of a process that finds other sources than the one that started it
_LENGTH = struct.Struct("<Q")


def pack(message: Any) -> bytes:
    """A message as it travels."""
    content = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    return _LENGTH.pack(len(content)) + content


def send(stream: IO[bytes], message: Any) -> None:
    """Raises OSError if nobody reads any more."""
    stream.write(pack(message))
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """The next message.  Raises EOFError if the other side ended, in the middle of one or before."""
    (length,) = _LENGTH.unpack(_exactly(stream, _LENGTH.size))
    return pickle.loads(_exactly(stream, length))


async def receive_async(stream: asyncio.StreamReader) -> Any:
    """The next message, for an event loop.  Raises asyncio.IncompleteReadError (an EOFError) and OSError."""
    (length,) = _LENGTH.unpack(await stream.readexactly(_LENGTH.size))
    return pickle.loads(await stream.readexactly(length))


def _exactly(stream: IO[bytes], count: int) -> bytes:
    content = stream.read(count)
    if len(content) < count:
        raise EOFError
    return content


# --- the interpreter, the code, the environment ---------------------------------------------------------

# Arrow's own allocator takes a gigabyte of address space that a limit on memory would count, and its thread would be on
# one side of a fork only
ALLOCATORS = {"ARROW_DEFAULT_MEMORY_POOL": "system", "JE_ARROW_MALLOC_CONF": "background_thread:false"}


def make_command(module: str, *arguments: str) -> list[str]:
    """Run a module, as ``python -m``; what lies in the working directory is not imported."""
    return [sys.executable, "-P", "-m", module, *arguments]


def refuse_unusable_kernels() -> None:
    """Raises KernelError where numba's settings in the environment rule out what is about to be started here.

    Before it serves, so that nobody waits for an answer that cannot come; without such settings it costs nothing.
    """
    values = {name: os.environ.get(f"NUMBA_{name}") for name in ("DISABLE_JIT", "CPU_NAME", "CPU_FEATURES")}
    if any(value is not None for value in values.values()):
        from tailstack.kernels.processor import refuse_unusable

        disabled = values["DISABLE_JIT"] not in (None, "", "0")
        refuse_unusable(disabled=disabled, name=values["CPU_NAME"], features=values["CPU_FEATURES"])


@cache
def digest_code() -> str:
    """Of all sources of this version, as this process first found them: the name of the code that it runs."""
    return _digest(sources.SOURCES)


def digest_files() -> str:
    """The same of the files as they are now."""
    return _digest(sources.read_sources(sources.ROOT))


def _digest(solver: dict[str, sources.SourceFile]) -> str:
    here = sources.digest_of_all(sources.read_sources(Path(__file__).resolve().parents[1]))
    return sha256(f"{sources.digest_of_all(solver)} {here}".encode()).hexdigest()


def running_code() -> str:
    """Version and sources of this process, ``0.1.0+4f1d0c9be2a7``: parts of one answer are computed by one code."""
    return f"{__version__}+{digest_code()[:12]}"


def make_environment() -> dict[str, str]:
    """The environment of this process, with its module path, but for what is on that because it is the working
    directory (``python -m`` puts it first, as an absolute path): a child takes no modules from there."""
    first = sys.path[:1] if _is_working_directory(*sys.path[:1]) else []
    path = os.pathsep.join(dict.fromkeys(entry for entry in sys.path[len(first) :] if entry))
    return {**os.environ, **SINGLE_THREADED, **ALLOCATORS, "PYTHONPATH": path}


def _is_working_directory(entry: str = "") -> bool:
    try:
        here = os.path.realpath(os.getcwd())
    except OSError:  # it was deleted
        return False
    ours = {os.path.realpath(Path(file).parents[1]) for file in (_file_of_solver, Path(__file__).parent)}
    return not sys.flags.safe_path and here not in ours and os.path.realpath(entry) == here


# What a signal says to whoever reads it in the problem of a job
REASONS = {
    "SIGILL": "illegal instruction: kernels built for another processor",
    "SIGKILL": "killed from outside, as where memory runs out",
}


def describe_ending(code: int) -> str:
    """What ended a process, from its return code: its exit code, or the signal by name and what that signal means."""
    if code >= 0:
        return f"exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:  # a real-time signal
        return f"signal {-code}"
    return f"{name} ({REASONS.get(name) or (signal.strsignal(-code) or 'signal').lower()})"


# --- what only Linux offers --------------------------------------------------------------------------------

# Elsewhere a computing process is started by itself and not forked, its memory has no limit, it is not killed by the
# end of its parent but leaves when its stdin ends, and nobody sees whether a silent one computes.  With
# TAILSTACK_PLAIN_PROCESSES=1 in the environment it is like that on Linux as well, as the tests of it need.
PR_SET_PDEATHSIG = 1
OOM_SCORE = 500  # where memory runs out, the unit that took it ends, and not the worker or the database
RESIDENT = 1  # field of /proc/PID/statm: what is in memory
WAITS_FOR_SYSTEM = {"R", "D"}  # states of a thread that waits for a processor or a disk, which is no fault of its own
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


def die_with_parent() -> None:
    """Be killed when the thread ends that started this process, and before others where memory runs out."""
    if ON_LINUX:
        import ctypes

        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        with suppress(OSError), open("/proc/self/oom_score_adj", "w") as score:
            score.write(str(OOM_SCORE))


def resident_bytes() -> int:
    """Of this process in memory; 0 elsewhere."""
    if ON_LINUX:
        with suppress(OSError), open("/proc/self/statm", "rb") as pages:
            return int(pages.read().split()[RESIDENT]) * os.sysconf("SC_PAGE_SIZE")
    return 0


def limit_memory(most_bytes: int) -> None:
    """For this process from now on, on what it can write to (``RLIMIT_DATA``), close to what it uses; 0: no limit.

    What goes beyond is refused, and nobody is killed.  Address space says nothing: LLVM and BLAS reserve hundreds of
    megabytes of it that they never touch.
    """
    if ON_LINUX and most_bytes:
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = most_bytes if hard == resource.RLIM_INFINITY else min(most_bytes, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def read_processor_time(pid: int) -> float | None:
    """Seconds that all threads of a process have used, of those that have ended, too; None where it has itself, and
    elsewhere."""
    fields = _read_stat(f"/proc/{pid}/stat")
    return (int(fields[11]) + int(fields[12])) / TICKS_A_SECOND if fields else None


def waits_for_system(pid: int) -> bool:
    """Whether a thread of a process does."""
    try:
        threads = os.listdir(Path(f"/proc/{pid}/task")) if ON_LINUX else []
    except OSError:  # it has ended
        return False
    states = {state for thread in threads for state in _read_stat(f"/proc/{pid}/task/{thread}/stat")[:1]}
    return not WAITS_FOR_SYSTEM.isdisjoint(states)


def _read_stat(file: str) -> list[str]:
    """State, 10 fields, ticks in user and in kernel mode and what follows; none of what is not there."""
    try:
        return Path(file).read_text().rpartition(")")[2].split() if ON_LINUX else []  # the name may hold anything
    except OSError:
        return []
