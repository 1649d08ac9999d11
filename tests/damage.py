"""Files as they come out of a broken transfer or a careless hand."""

from __future__ import annotations

import random
from collections.abc import Sequence

JUNK = [
    *(b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\r\n", b"\t", b"!!int ", b"&a ", b"*a ", b"{", b"[", b"- ", b": ", b"? "),
    *(b"|", b"%YAML 9.9\n", b"---\n", b"...\n", b"'", b'"', b".nan", b"1e999", b"\xc3\x28", b"\xed\xa0\x80", b"~"),
    *(b"<<: *a\n", "\u2028".encode(), "\U0001f4a9".encode(), b"0x10", b"1:30", b"#", b"9" * 6000),
]  # fmt: skip


def damaged(content: bytes, rng: random.Random, junk: Sequence[bytes] = JUNK) -> bytes:
    """One to four cuts, copies, flips and insertions of bytes."""
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(content) + 1)
        other = rng.randrange(len(content) + 1)
        kind = rng.randrange(5)
        if kind == 0:
            content = content[:at]
        elif kind == 1:
            content = content[:at] + rng.choice(junk) + content[at:]
        elif kind == 2:
            content = content[:at] + content[min(at, other) : min(at, other) + 200] + content[at:]
        elif kind == 3:
            content = content[:at] + content[at + rng.randint(1, 60) :]
        elif content:
            where = rng.randrange(len(content))
            content = content[:where] + bytes([rng.randrange(256)]) + content[where + 1 :]
    return content
