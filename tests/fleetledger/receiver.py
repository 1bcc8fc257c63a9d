"""A receiver of callbacks on a port of this machine, as unreliable as the tests want it."""

import asyncio
import hashlib
import hmac
import json
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from random import Random
from typing import Any, Self

WAIT_S = 60.0

ACCEPT = b"HTTP/1.1 204 No Content\r\n\r\n"
REFUSE = b"HTTP/1.1 500 Internal Server Error\r\nContent-Length: 4\r\n\r\noops"
SEND_ELSEWHERE = b"HTTP/1.1 302 Found\r\nLocation: /elsewhere\r\nContent-Length: 0\r\n\r\n"
SLOWLY = b"HTTP/1.1 200 OK\r\nContent-Length: 1000000\r\n\r\nbut only this"  # never the rest
NONSENSE = b"SSH-2.0-what\r\n"
DROP = b""  # the connection goes, after the body was taken
HANG = b"hang"
HOLD = b"hold"  # accepted once the test lets go
PATIENCE = 4  # a moody receiver accepts what it has seen so often

Behaviour = Callable[[dict[str, Any]], bytes]


@dataclass(frozen=True)
class Got:
    """A callback that came in whole."""

    path: str
    headers: dict[str, str]
    raw: bytes
    body: dict[str, Any]
    answer: bytes  # what was done with it


def accept(_: dict[str, Any]) -> bytes:
    return ACCEPT


class Moody:
    """Answers by chance, but accepts in the end."""

    def __init__(self, random: Random, *answers: bytes, rare: Sequence[bytes] = ()) -> None:
        self._random, self._answers, self._rare = random, answers, rare
        self._seen: Counter[str] = Counter()

    def __call__(self, body: dict[str, Any]) -> bytes:
        self._seen[body["id"]] += 1
        if self._seen[body["id"]] > PATIENCE:
            return ACCEPT
        if self._rare and self._random.random() < 0.03:
            return self._random.choice(self._rare)
        return self._random.choice(self._answers)


class Receiver:
    """Keeps what comes in, in the order in which it came."""

    def __init__(self, behave: Behaviour = accept) -> None:
        self.got: list[Got] = []
        self._behave = behave
        self._changed = threading.Condition()
        self._up = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)
        self.at_once = 0  # connections on which something is being answered …
        self.at_once_max = 0  # … at most

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._up.wait(WAIT_S)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(WAIT_S)

    def let_go(self) -> None:
        """Accept what is held."""
        self._loop.call_soon_threadsafe(self._held.set)

    def url(self, path: str = "/orders") -> str:
        return f"http://127.0.0.1:{self.port}{path}"

    def until(self, enough: Callable[[list[Got]], bool]) -> list[Got]:
        """Wait for what came in to be enough."""
        with self._changed:
            assert self._changed.wait_for(lambda: enough(self.got), WAIT_S), self.got[-3:]
            return list(self.got)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._stop, self._held = asyncio.Event(), asyncio.Event()
        server = await asyncio.start_server(self._answer_all, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._up.set()
        await self._stop.wait()
        server.close()

    async def _answer_all(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError, asyncio.IncompleteReadError, asyncio.CancelledError):
            while await self._answer_one(reader, writer):
                pass
        writer.close()

    async def _answer_one(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")
        headers = dict(line.lower().split(": ", 1) for line in head[1:] if line)
        raw = await reader.readexactly(int(headers["content-length"]))
        body = json.loads(raw)
        answer = self._behave(body)
        self.at_once += 1
        self.at_once_max = max(self.at_once, self.at_once_max)
        with self._changed:
            self.got.append(Got(head[0].split(" ")[1], headers, raw, body, answer))
            self._changed.notify_all()
        try:
            if answer == HANG:
                await reader.read()  # until the other side gives up
            elif answer == HOLD:
                await self._held.wait()
                writer.write(ACCEPT)
            else:
                writer.write(answer)
                await writer.drain()
        finally:
            self.at_once -= 1
        return answer in (ACCEPT, HOLD, REFUSE, SEND_ELSEWHERE)


def is_signed(got: Got, secret: str) -> bool:
    """Check a signature as docs/callbacks.md says."""
    signed = got.headers["x-fleetledger-timestamp"].encode() + b"." + got.raw
    right = hmac.new(secret.encode(), signed, hashlib.sha256).hexdigest()
    return got.headers["x-fleetledger-signature"] == f"sha256={right}"


def no_step_back(got: Sequence[Got]) -> None:
    """Nobody hears of a state again after the next one: repetitions come at once."""
    newest: dict[tuple[str, str], str] = {}
    seen: set[tuple[str, str]] = set()
    for one in got:
        lane = one.path, one.body["orderId"]
        if newest.get(lane) != one.body["id"]:
            assert (one.path, one.body["id"]) not in seen
        newest[lane] = one.body["id"]
        seen.add((one.path, one.body["id"]))
