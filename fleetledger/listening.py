"""Sockets that applications are served on: limits of a connection, and TLS."""

import asyncio
import socket
import ssl
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

import uvicorn
from starlette.types import ASGIApp, Scope
from uvicorn.protocols.http.httptools_impl import (
    STATUS_LINE,
    HttpToolsProtocol,
    RequestResponseCycle,
)

from fleetledger.config import Settings
from fleetledger.middleware import Give, header_lines
from ledger.errors import Refused
from replay.following import ABORT

BACKLOG = 2048
CONNECTIONS_MAX = 4096  # at once
WS_BYTES_MAX = 1_000_000  # of a frame; beyond, the connection is closed (code 1009)
KEEP_ALIVE_S = 65
STOP_REQUESTS_S = 1  # for requests under way when told to stop; 5 s in all (contract)
HEAD_S_MAX = 10.0  # from a connection, or a call's first byte, to the end of its headers
HEAD_BYTES_MAX = 65_536  # where the parser gives up; the gate refuses smaller ones in words


def tls_of(settings: Settings) -> ssl.SSLContext | None:
    """Read the TLS files of the settings; None where there are none."""
    if settings.tls_cert is None or settings.tls_key is None:
        return None
    return tls_context(settings.tls_cert, settings.tls_key)


def tls_context(cert: Path, key: Path) -> ssl.SSLContext:
    """Read a certificate chain and its key, both PEM; raises Refused where they do not fit."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(cert, key, password=_no_password)
    except (OSError, ssl.SSLError, ValueError) as trouble:
        words = (
            f"--tls-cert {cert} and --tls-key {key} are not the PEM files of a certificate chain "
            f"and its key without a password: {trouble}"
        )
        raise Refused("errTlsFiles", words, str(cert), str(key)) from trouble
    return context


def _no_password() -> str:
    """Keep OpenSSL from asking on the terminal."""
    raise ValueError("the key is encrypted")


def free_port() -> int:
    """Give a port of this machine that nobody listens on just now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@asynccontextmanager
async def served(
    app: ASGIApp, host: str, port: int, tls: ssl.SSLContext | None = None
) -> AsyncIterator[int]:
    """Serve an application; gives the port, which is free to choose where 0 was asked."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as trouble:
        listener.close()
        words = f"Cannot listen on {host}:{port}: {trouble.strerror}. Choose another port."
        raise Refused("errCannotListen", words, host, port) from trouble
    config = uvicorn.Config(
        app,
        http=Connection,
        log_config=None,
        access_log=False,
        backlog=BACKLOG,
        timeout_keep_alive=KEEP_ALIVE_S,
        timeout_graceful_shutdown=STOP_REQUESTS_S,
        ws_max_size=WS_BYTES_MAX,
        ws_per_message_deflate=False,  # it compresses per client: 24 ms a frame (measured)
        server_header=False,
        proxy_headers=False,
        lifespan="off",
        ssl_context_factory=None if tls is None else lambda config, default: tls,
    )
    server = _Server(config)
    serving = asyncio.create_task(server.serve([listener]))
    await server.up.wait()
    try:
        yield listener.getsockname()[1]
    finally:
        server.should_exit = True
        await serving


class _Server(uvicorn.Server):
    """uvicorn that says when it is up, and leaves signals to the front door."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.up = asyncio.Event()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=sockets)
        self.up.set()

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


@runtime_checkable
class TakesQuickCalls(Protocol):
    """An application that serves some calls without a coroutine; `Gate` is one."""

    def is_quick(self, method: bytes, target: bytes) -> bool:
        """Tell whether `take` may be asked, from the head's first line."""

    def take(self, scope: Scope, body: bytes, give: Give) -> bool:
        """Answer by `give`, now or later, on this thread; False = it must go the ordinary way."""


class _UnderWay:
    """A quick call, in the place of uvicorn's cycle: what uvicorn asks of one."""

    message_event = asyncio.Event()  # nobody waits for it

    def __init__(self) -> None:
        self.response_complete = False
        self.disconnected = False
        self.keep_alive = True


class Connection(HttpToolsProtocol):
    """uvicorn's, closed when a call's head takes too long or gets too large.

    uvicorn itself waits for ever, and keeps all that comes meanwhile. Quick calls, which come
    whole in one piece on a connection that has nothing else to do, pass it by: its cycle of events
    and tasks, and two writes for an answer, took a fifth of what an order costs (measured).
    """

    _parts: list[bytes] | None = None  # of a quick call's body that is being parsed
    _head_open = True  # its end has not come
    _head_bytes = 0  # of an open one
    _head_timer: asyncio.TimerHandle | None = None

    def __init__(self, *args: Any, **keywords: Any) -> None:
        """Take what uvicorn gives."""
        super().__init__(*args, **keywords)
        self._quick = self.app if isinstance(self.app, TakesQuickCalls) else None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first head."""
        super().connection_made(transport)
        if len(self.connections) > CONNECTIONS_MAX:
            transport.abort()
        self._head_timer = self.loop.call_later(HEAD_S_MAX, transport.abort)

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        self._stop_waiting()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Count what comes of a head that has not ended; nearly all come in one piece."""
        super().data_received(data)
        if self._parts is not None:
            if self.transport.is_closing():  # it was no HTTP
                self._parts = None
            else:  # the rest comes later
                self._take_ordinary_way()
        if not self._head_open:
            return
        self._head_bytes += len(data)
        if self._head_bytes > HEAD_BYTES_MAX:
            self.transport.abort()
        elif self._head_timer is None:
            self._head_timer = self.loop.call_later(HEAD_S_MAX, self.transport.abort)

    def on_message_begin(self) -> None:
        """Take note that a head begins."""
        self._head_open = True
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        """Take note that the head has come whole."""
        self._head_open, self._head_bytes = False, 0
        self._stop_waiting()
        if self._may_be_quick():
            self._parts = []
        else:
            self._go_ordinary_way()

    def on_body(self, body: bytes) -> None:
        """Keep a part of the body."""
        if self._parts is None:
            super().on_body(body)
        else:
            self._parts.append(body)

    def on_message_complete(self) -> None:
        """Serve a quick call."""
        if self._parts is None or self._quick is None:
            super().on_message_complete()
            return
        scope = cast("dict[str, Any]", self.scope)
        scope["method"] = self.parser.get_method().decode("ascii")
        scope["path"] = self.url.decode("ascii")
        scope["raw_path"], scope["query_string"] = self.url, b""
        before, under_way = self.cycle, _UnderWay()
        self.cycle = cast("RequestResponseCycle", under_way)
        if self._quick.take(scope, b"".join(self._parts), partial(self._give, under_way)):
            self._parts = None
        else:
            self.cycle = before
            self._take_ordinary_way()
            super().on_message_complete()

    def _may_be_quick(self) -> bool:
        return (
            self._quick is not None
            and self._quick.is_quick(self.parser.get_method(), self.url)
            and (self.cycle is None or self.cycle.response_complete)
            and self.parser.get_http_version() == "1.1"
            and self.parser.should_keep_alive()
            and not self.parser.should_upgrade()
            and not self.expect_100_continue
            and not self.flow.write_paused
        )

    def _take_ordinary_way(self) -> None:
        """Let uvicorn have what has come."""
        assert self._parts is not None
        parts, self._parts = self._parts, None
        self._go_ordinary_way()
        for part in parts:
            super().on_body(part)

    def _go_ordinary_way(self) -> None:
        self.scope.setdefault("extensions", {})[ABORT] = {"call": self.transport.abort}
        super().on_headers_complete()

    def _give(self, call: _UnderWay, status: int, headers: bytes, body: bytes) -> None:
        """Write the answer, in one piece."""
        call.response_complete = True
        if call.disconnected or self.transport.is_closing():
            return
        ours = header_lines(self.server_state.default_headers)
        last = b"\r\n" if call.keep_alive else b"connection: close\r\n\r\n"
        self.transport.write(b"".join((STATUS_LINE[status], ours, headers, last, body)))
        if not call.keep_alive:
            self.transport.close()
        self.on_response_complete()

    def _stop_waiting(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None
