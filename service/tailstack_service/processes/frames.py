"""What a computing process and the process that started it say to each other, and how a computation can fail.

A message is a frame: its length, then a pickle.  Both ends are the same version of the same program on one host.

A computing process says its pid when it is ready.  Of each task it says ``BEGUN``, then perhaps, when what was sent has
been read, how many seconds of CPU the rest is expected to take (a float), to which the answer is whether it is to go on
(True) or to leave it at that, then the outcome: what came of it, the traceback of a defect, whether the process is to
be replaced, and the seconds of CPU that it took.
"""

from __future__ import annotations

import asyncio
import pickle
import struct
from typing import IO, Any

PERFORM = "tailstack_service.operations.perform:perform"  # computes the units of jobs
CHECK = "tailstack_service.operations.perform:check_once"  # calls the kernels that nearly every task needs
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


class Died(Exception):
    """The process that was computing the task ended under it; no other task was in that process."""


class NotBegun(Died):
    """It ended before it took up the task."""


class PutBack(Exception):
    """The task was read, and the rest, which will take so many seconds, was left for later."""

    def __init__(self, seconds: float) -> None:
        super().__init__(seconds)
        self.seconds = seconds


class Defect(Exception):
    """The task raised what is not a refusal; the text is its traceback."""


class GivenBack(Exception):
    """The task was not computed, and not through any fault of its own."""


class OutOfDate(GivenBack):
    """Not computed, because the files of tailstack are no longer those that this process was started from."""
