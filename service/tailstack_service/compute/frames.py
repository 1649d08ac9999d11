"""Messages between a worker or an API process and its computing processes: a length, then a pickle."""

from __future__ import annotations

import asyncio
import pickle
import struct
from typing import IO, Any

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
