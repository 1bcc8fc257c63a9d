"""Connections over a real socket: heads that do not end are not waited for."""

import asyncio
from contextlib import suppress

import pytest
from starlette.responses import PlainTextResponse

from fleetledger import listening
from fleetledger.listening import HEAD_BYTES_MAX, served

CALL = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"


async def _closed(writer: asyncio.StreamWriter) -> None:
    writer.close()
    with suppress(ConnectionError):
        await writer.wait_closed()


async def _after(sent: bytes, port: int) -> bytes:
    """Send, and read until the server closes."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(sent)
        return await asyncio.wait_for(reader.read(), 30)
    except ConnectionResetError:
        return b""
    finally:
        await _closed(writer)


@pytest.mark.parametrize(
    "sent", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: localhost\r\nX: y", CALL + b"GET / H"]
)
async def test_a_head_that_does_not_end_is_not_waited_for(
    sent: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listening, "HEAD_S_MAX", 0.2)
    async with served(PlainTextResponse("yes"), "127.0.0.1", 0) as port:
        got = await _after(sent, port)
    assert got.count(b"200 OK") == sent.count(CALL)


async def test_a_head_without_end_is_not_collected() -> None:
    async with served(PlainTextResponse("yes"), "127.0.0.1", 0) as port:
        got = await _after(CALL[:-2] + b"X: " + b"y" * (2 * HEAD_BYTES_MAX), port)
    assert got == b""


async def test_calls_may_follow_each_other_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listening, "HEAD_S_MAX", 0.2)
    async with served(PlainTextResponse("yes"), "127.0.0.1", 0) as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        began = asyncio.get_running_loop().time()
        while asyncio.get_running_loop().time() < began + 0.5:
            writer.write(CALL)
            assert b"200 OK" in await reader.readuntil(b"yes")
        await _closed(writer)
