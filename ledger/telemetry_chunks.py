"""The chunks of one telemetry file: where they lie, what time they cover, what they hold.

The stock reader wants a finished file, or reads all of it; a time slider wants one second out of an
hour, also of the file that is being written, or that a crash has left without a footer.
"""

import mmap
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel

from ledger.telemetry_format import NS_PER_MS, PLANS_TOPIC, REPORTS_TOPIC

MAGIC_BYTES = 8
RECORD = struct.Struct("<BQ")  # opcode, length
CHUNK = struct.Struct("<QQQII")  # start, end, size, CRC, length of the compression's name
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
CHUNK_BYTES_MAX = 64 * 1024 * 1024  # of a chunk unpacked; a greater size is damage


class Chunk(NamedTuple):
    """Where one chunk's content lies, and the time it covers."""

    offset: int
    length: int
    start_ms: int
    end_ms: int


class Message(NamedTuple):
    """One message of our own two topics."""

    topic: str
    at_ms: int
    data: bytes


class ChunkFile:
    """One telemetry file, as far as it was scanned."""

    def __init__(self, path: Path) -> None:
        """Take the file; nothing is read yet."""
        self.path = path
        self.chunks: list[Chunk] = []
        self._channels: dict[int, str] = {}
        self._scanned = MAGIC_BYTES

    def scan(self) -> None:
        """Find what was appended since the last scan, up to a torn tail."""
        try:
            size = self.path.stat().st_size
            if size < self._scanned + RECORD.size:
                return
            with (
                self.path.open("rb") as stream,
                mmap.mmap(stream.fileno(), size, access=mmap.ACCESS_READ) as content,
            ):
                self._scan(content, size)
        except OSError:  # retention was quicker
            self.chunks = []

    def _scan(self, content: mmap.mmap, size: int) -> None:
        at = self._scanned
        while at + RECORD.size <= size:
            opcode, length = RECORD.unpack_from(content, at)
            body = at + RECORD.size
            if body + length > size:
                break  # still being written, or torn
            if opcode == Opcode.DATA_END:
                at = size  # the summary behind it holds nothing new
                break
            if opcode == Opcode.CHUNK and length >= CHUNK.size:
                start_ns, end_ns, *_ = CHUNK.unpack_from(content, body)
                chunk = Chunk(body, length, start_ns // NS_PER_MS, end_ns // NS_PER_MS)
                self.chunks.append(chunk)
            at = body + length
        self._scanned = at

    def messages(self, chunk: Chunk) -> list[Message]:
        """Unpack the messages of our own topics; a damaged chunk has none."""
        if not self._channels and chunk is not self.chunks[0]:
            self.messages(self.chunks[0])  # the channels are made known there
        try:
            with self.path.open("rb") as stream:
                stream.seek(chunk.offset)
                data = _unpacked(stream.read(chunk.length))
        except OSError:
            return []
        return list(self._messages(data))

    def _messages(self, data: bytes) -> Iterator[Message]:
        at = 0
        while at + RECORD.size <= len(data):
            opcode, length = RECORD.unpack_from(data, at)
            at += RECORD.size
            if opcode == Opcode.MESSAGE:
                channel, _, log_ns, _ = MESSAGE.unpack_from(data, at)
                if channel in self._channels:
                    body = data[at + MESSAGE.size : at + length]
                    yield Message(self._channels[channel], log_ns // NS_PER_MS, body)
            elif opcode == Opcode.CHANNEL and len(self._channels) < 2:
                self._learn(data[at : at + length])
            at += length

    def _learn(self, record: bytes) -> None:
        channel = Channel.read(ReadDataStream(BytesIO(record)))
        if channel.topic in (REPORTS_TOPIC, PLANS_TOPIC):
            self._channels[channel.id] = channel.topic


def _unpacked(packed: bytes) -> bytes:
    """Decompress and check a chunk's content; damage gives nothing."""
    if len(packed) < CHUNK.size:
        return b""
    _, _, size, crc, name_length = CHUNK.unpack_from(packed)
    name = packed[CHUNK.size : CHUNK.size + name_length]
    data = packed[CHUNK.size + name_length + 8 :]  # 8 = the length of what follows
    if size > CHUNK_BYTES_MAX:
        return b""
    try:
        if name == b"zstd":
            data = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    except zstandard.ZstdError:
        return b""
    return data if zlib.crc32(data) == crc else b""
