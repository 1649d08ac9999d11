"""Small files that stand for gigabytes are refused while they are read: no process grows, and none is killed for it."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from unittest.mock import patch
from zipfile import ZipExtFile

import httpx
import psutil
import pyarrow
import pytest
from bombs import BOMBS, NOISE
from served import Served, served
from service_scenes import ask, check_problem, small_design

from family import forget_peak, forked_of, peak_bytes, run_python
from tailstack.errors import LimitError
from tailstack_service.problems import RequestError
from tailstack_service.tables import MEDIA_TYPES, read_table

MB = 1_000_000
API_GROWTH = 40 * MB  # with a body of 8 MB, as it arrives and as it leaves for the computing process
CHILD_PEAK = 1_000 * MB  # 400 of them before


@dataclass(frozen=True, slots=True)
class Place:
    service: Served
    sha256: str

    def post(self, media: str, body: bytes) -> httpx.Response:
        return ask(
            "POST", f"{self.service.url}/v1/scores/batch", params={"design_sha256": self.sha256}, content=body,
            headers={"Content-Type": media},
        )  # fmt: skip

    def computing(self) -> psutil.Process:
        """The only computing process of the API."""
        (only,) = forked_of(self.service.pid)
        return only


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with served(tmp_path_factory.mktemp("bombs"), "--no-worker") as service:
        answer = ask("POST", f"{service.url}/v1/validations", json={"design": small_design()})
        yield Place(service, answer.json()["design_sha256"])


# One of each format is cheap to make and to refuse
SHORT = (
    "1 kB of Arrow: 200 rows of one text of 8 MB",
    "1 kB of Parquet: 50 rows of 400 kB",
    "10 kB of XLSX: elements a million deep",
    "1 MB of CSV: a cell",
    "1 MB of lines: a cell",
)
WORKBOOKS = [name for name, (form, _) in BOMBS.items() if form == "xlsx"]
MOST_XML = 8 * MB  # a sheet of nothing but rows, one more than there may be


@pytest.mark.long(but=SHORT)
@pytest.mark.parametrize("name", BOMBS)
def test_a_small_file_that_stands_for_gigabytes_is_refused(place: Place, name: str) -> None:
    form, make = BOMBS[name]
    body = make()
    child = place.computing()
    held = forget_peak(place.service.pid)
    forget_peak(child.pid)
    answer = place.post(MEDIA_TYPES[form], body)
    slug = answer.json()["type"].rpartition("/")[2]
    assert slug in ("limit-exceeded", "invalid-request"), answer.text
    check_problem(answer, 422, slug)
    assert place.computing() == child
    assert peak_bytes(place.service.pid) - held < API_GROWTH
    assert peak_bytes(child.pid) < CHILD_PEAK


@pytest.mark.long(but=["10 kB of XLSX: elements a million deep", "10 kB of XLSX: a million deep, behind"])
@pytest.mark.parametrize("name", WORKBOOKS)
def test_a_workbook_is_unpacked_as_far_as_its_first_excess(name: str) -> None:
    """Of up to 600 MB of XML; how long that takes is told in docs/decisions/008."""
    unpacked = 0
    read = ZipExtFile.read

    def counted(self: ZipExtFile, size: int | None = -1) -> bytes:
        nonlocal unpacked
        part = read(self, size)
        unpacked += len(part)
        return part

    body = BOMBS[name][1]()
    with patch.object(ZipExtFile, "read", counted), pytest.raises((LimitError, RequestError)):
        for _ in read_table(BytesIO(body), "xlsx", most_bytes=16 * MB).blocks:
            pass
    assert unpacked < MOST_XML


def test_an_offset_beyond_its_buffer_reads_nothing_of_the_process(place: Place) -> None:
    """The texts of a column end 4 kB behind their buffer: what lies there may be another tenant's design."""
    table = pyarrow.RecordBatch.from_arrays(
        [pyarrow.array([0.3, 0.4]), pyarrow.array(["note", "more"])], names=[NOISE, "note"]
    )
    sink = pyarrow.BufferOutputStream()
    with pyarrow.ipc.new_stream(sink, table.schema) as stream:
        stream.write_batch(table)
    sound = sink.getvalue().to_pybytes()
    assert sound.count(struct.pack("<3i", 0, 4, 8)) == 1
    damaged = sound.replace(struct.pack("<3i", 0, 4, 8), struct.pack("<3i", 0, 4, 4096))
    child = place.computing()
    assert place.post(MEDIA_TYPES["arrow"], sound).status_code == 200
    answer = place.post(MEDIA_TYPES["arrow"], damaged)
    check_problem(answer, 422, "invalid-request")
    assert place.computing() == child


def test_what_takes_too_much_memory_is_refused_and_the_process_goes_on() -> None:
    """Under the limit of the system: at once, and no matter who asks for it."""
    program = """
from functools import partial
from tailstack_service.http.computations import perform
from tailstack_service.operations.perform import perform as perform_unit
from tailstack_service.processes.linux import limit_memory, memory_within
from tailstack_service.processes.task import Task
limit_memory(600_000_000)
refused = perform(partial(bytearray, 900_000_000))
print(refused.slug, refused.problems[0].hint)
try:
    with memory_within(50_000_000):
        bytearray(100_000_000)
except MemoryError:
    print(len(bytearray(100_000_000)))
"""
    done = run_python("-c", program)
    assert done.returncode == 0, done.stderr
    assert "limit-exceeded" in done.stdout
    assert "TAILSTACK_MAX_PROCESS_BYTES" in done.stdout
    assert done.stdout.endswith("100000000\n")
