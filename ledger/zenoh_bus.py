"""The bus between processes: zenoh as peers on explicit addresses, nothing found by scouting.

Handlers run on zenoh's threads. Close it in a `finally`: an open session keeps the process alive.
"""

import json
import threading
from collections.abc import Callable, Sequence
from typing import cast
from urllib.parse import unquote

import structlog
import zenoh

from ledger.bus import EVENTS_AFTER_KEY, EVENTS_KEY, Collected, Handler, Responder, Watcher
from ledger.errors import Refused

LOOPBACK = "tcp/127.0.0.1"
CONNECT_RETRY_MS = 100
CONNECT_RETRY_MS_MAX = 1000
LEASE_MS = 10_000  # how long a peer that hangs without closing its connection counts as there
# the next one replaces it, or shows that it is missing: a listener that stalls holds up nobody
LOSSY = ("/report", "/plans", EVENTS_KEY, EVENTS_AFTER_KEY)
QUEUE_BATCHES = 16  # of 64 kB wait for each neighbour (zenoh's most), before anything is lost

log = structlog.get_logger()


def _expression(key: str) -> str:
    """Key as a zenoh key expression: names may hold characters that mean something to zenoh."""
    chunks = (part if part in ("*", "**") else _escaped(part) for part in key.split("/"))
    return "/".join(chunks)


def _escaped(part: str) -> str:
    return "".join(f"%{ord(c):02X}" if c in "%*$?#" else c for c in part)


def _under_load(key: str) -> zenoh.CongestionControl:
    """Say what happens where a neighbour does not read: to wait costs 5 s (measured)."""
    drop = key.endswith(LOSSY)
    return zenoh.CongestionControl.DROP if drop else zenoh.CongestionControl.BLOCK


def _key(expression: zenoh.KeyExpr) -> str:
    return unquote(str(expression))


class ZenohBus:
    """One session. Endpoints are spelt as zenoh does: `tcp/127.0.0.1:7447`."""

    def __init__(self, listen: str | None, connect: Sequence[str] = ()) -> None:
        """Listen on one endpoint, or none, and keep trying to connect to others.

        Raises Refused where the endpoint cannot be listened on.
        """
        config = zenoh.Config()
        settings: dict[str, object] = {
            "mode": "peer",
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "listen/endpoints": [listen] if listen else [],
            "listen/exit_on_failure": True,
            "connect/endpoints": list(connect),
            "connect/timeout_ms": -1,  # for ever: processes start in any order
            "connect/exit_on_failure": False,
            "connect/retry": {
                "period_init_ms": CONNECT_RETRY_MS,
                "period_max_ms": CONNECT_RETRY_MS_MAX,
            },
            "transport/link/tx/lease": LEASE_MS,
            "transport/link/tx/queue/size/data": QUEUE_BATCHES,
        }
        for name, value in settings.items():
            config.insert_json5(name, json.dumps(value))
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as trouble:
            words = f"The bus cannot listen on {listen}; choose another port: {trouble}"
            raise Refused("errCannotListen", words, listen) from trouble
        self._lock = threading.Lock()
        self._kept: list[object] = []  # subscriptions end when nobody holds them
        self._there: dict[str, threading.Event] = {}
        self._closed = False

    def _keep(self, thing: object) -> None:
        with self._lock:
            self._kept.append(thing)

    def publish(self, key: str, payload: bytes) -> None:
        """Send to all who subscribe now; reports, plans and events may be lost under load.

        Once closed it talks to nobody: a proposal may still be decided while the server ends, and
        what it leads to must not look like a ledger that cannot be listened to.
        """
        try:
            self._session.put(_expression(key), payload, congestion_control=_under_load(key))
        except zenoh.ZError:
            if not self._closed:
                raise

    def subscribe(self, key: str, handler: Handler) -> None:
        """Get every message under the key, on a zenoh thread."""

        def received(sample: zenoh.Sample) -> None:
            handler(_key(sample.key_expr), sample.payload.to_bytes())

        self._keep(self._session.declare_subscriber(_expression(key), received))

    def collect(self, key: str, most: int) -> Collected:
        """Keep the newest messages in a ring of zenoh's, whose threads then need no interpreter."""
        ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(most)
        subscriber = self._session.declare_subscriber(_expression(key), ring)
        self._keep(subscriber)

        def fetch() -> bytes | None:
            sample = subscriber.try_recv()
            return None if sample is None else sample.payload.to_bytes()

        return fetch

    def respond(self, key: str, responder: Responder) -> None:
        """Answer questions, on a zenoh thread; a failure is logged and answers the question."""
        expression = _expression(key)

        def asked(query: zenoh.Query) -> None:
            with query:
                try:
                    question = query.payload.to_bytes() if query.payload else b""
                    for answer in responder(question):
                        query.reply(expression, answer)
                except Exception as error:  # a foreign thread: nobody else would ever hear of it
                    log.exception("question failed", key=key)
                    query.reply_err(f"{type(error).__name__}: {error}".encode())

        self._keep(self._session.declare_queryable(expression, asked, complete=True))

    def _somebody(self, key: str) -> threading.Event:
        """Event that is set while there is a responder for the key. Keys are few and of our own."""
        with self._lock:
            if key in self._there:
                return self._there[key]
            there = self._there[key] = threading.Event()

        def changed(status: zenoh.MatchingStatus) -> None:
            if status.matching:
                there.set()
            else:
                there.clear()

        querier = self._session.declare_querier(_expression(key))
        self._keep(querier)
        self._keep(querier.declare_matching_listener(changed))
        # 1.10 gives a MatchingStatus here, though its stubs promise a bool
        status = cast("zenoh.MatchingStatus", querier.matching_status)
        if status.matching:
            there.set()
        return there

    def ask(self, key: str, payload: bytes = b"", timeout_s: float = 5.0) -> list[bytes]:
        """Ask, and wait for all answers, in order.

        Where nobody answers such questions yet, it waits for somebody to come: processes start in
        any order. Raises TimeoutError where there is no answer, or not the whole of it.
        """
        if not self._somebody(key).wait(timeout_s):
            raise TimeoutError(f"nobody answers {key}")
        replies = self._session.get(
            _expression(key),
            payload=payload,
            timeout=timeout_s,
            # by default only one of all answers under one key would arrive
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=_under_load(key),  # of the answers too
        )
        answers: list[bytes] = []
        for reply in replies:
            if reply.ok is None:
                words = reply.err.payload.to_string() if reply.err else "no reason given"
                raise TimeoutError(f"{key} was not answered: {words}")
            answers.append(reply.ok.payload.to_bytes())
        if not answers:
            raise TimeoutError(f"nobody answers {key}")
        return answers

    def live(self, key: str) -> Callable[[], None]:
        """Hold a token; it vanishes with the process at the latest."""
        token = self._session.liveliness().declare_token(_expression(key))
        self._keep(token)

        def let_go() -> None:
            with self._lock:
                if token not in self._kept:
                    return
                self._kept.remove(token)
            token.undeclare()  # type: ignore[no-untyped-call]

        return let_go

    def watch(self, key: str, watcher: Watcher) -> None:
        """Learn of tokens that are there, come and go, on a zenoh thread."""

        def changed(sample: zenoh.Sample) -> None:
            watcher(_key(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        subscriber = self._session.liveliness().declare_subscriber(
            _expression(key), changed, history=True
        )
        self._keep(subscriber)

    def close(self) -> None:
        """Leave; a second time does nothing."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._kept.clear()
        self._session.close()  # type: ignore[no-untyped-call]
