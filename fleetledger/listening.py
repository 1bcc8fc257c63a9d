"""Sockets that applications are served on: limits of a connection, and TLS."""

import asyncio
import socket
import ssl
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from fleetledger.config import Settings
from ledger.errors import Refused

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


class Connection(HttpToolsProtocol):
    """uvicorn's, closed when a call's head takes too long or gets too large.

    uvicorn itself waits for ever, and keeps all that comes meanwhile.
    """

    _head_open = True  # its end has not come
    _head_bytes = 0  # of an open one
    _head_timer: asyncio.TimerHandle | None = None

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
        super().on_headers_complete()

    def _stop_waiting(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None
