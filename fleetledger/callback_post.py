"""One try to deliver a callback: signed, bounded in time and size, and trusting nobody."""

import asyncio
import hashlib
import hmac
import ssl
from collections.abc import Callable
from contextlib import suppress

import httpx

from ledger.ids import SceneId
from projections.callbacks import Callback

TRY_S = 5.0  # from connecting to the status line of the answer
DRAIN_S = 0.5  # for the rest of an answer, which nobody reads: a connection is kept for it
DRAIN_BYTES_MAX = 65_536
KEPT_CONNECTIONS_MAX = 64

ID_HEADER = "X-Fleetledger-Id"
TIMESTAMP_HEADER = "X-Fleetledger-Timestamp"
SIGNATURE_HEADER = "X-Fleetledger-Signature"

NO_SECRET = "there is no secret to sign with: set one at scenes/{sceneId}/callbacks"


class NoSecret(Exception):
    """Nothing can be sent unsigned; this is the operator's to mend, no try was made."""


def signature(secret: str, timestamp: str, body: bytes) -> str:
    """Sign what is sent and when, so that a receiver can refuse what is old (docs/callbacks.md)."""
    signed = timestamp.encode() + b"." + body
    return "sha256=" + hmac.new(secret.encode(), signed, hashlib.sha256).hexdigest()


class Post:
    """The client; use it on one event loop only."""

    def __init__(
        self,
        secret: Callable[[SceneId], str | None],
        wall_ms: Callable[[], int],
        try_s: float = TRY_S,
    ) -> None:
        """Take whence secrets come, and the clock that receivers have too, which is never scaled.

        Proxies of the environment are not used. The system's certificates count: a plant's own
        authority is added there.
        """
        self._secret = secret
        self._wall_ms = wall_ms
        self._try_s = try_s
        self._client = httpx.AsyncClient(
            trust_env=False,
            follow_redirects=False,
            verify=ssl.create_default_context(),
            timeout=try_s,
            limits=httpx.Limits(
                max_connections=None, max_keepalive_connections=KEPT_CONNECTIONS_MAX
            ),
            headers={"user-agent": "fleetledger", "accept": "*/*"},
        )

    async def send(self, callback: Callback) -> str | None:
        """Send once. None = accepted; else what went wrong, in words. Raises NoSecret."""
        secret = self._secret(callback.scene)
        if secret is None:
            raise NoSecret(NO_SECRET)
        timestamp = str(self._wall_ms())
        headers = {
            "content-type": "application/json",
            ID_HEADER: callback.id,
            TIMESTAMP_HEADER: timestamp,
            SIGNATURE_HEADER: signature(secret, timestamp, callback.body),
        }
        status = 0
        try:
            async with asyncio.timeout(self._try_s) as limit:
                async with self._client.stream(
                    "POST", callback.url, content=callback.body, headers=headers
                ) as response:
                    status = response.status_code
                    limit.reschedule(asyncio.get_running_loop().time() + DRAIN_S)
                    await _drain(response)
        except TimeoutError:
            if not status:
                return f"no answer in {self._try_s:g} s"
        except (httpx.HTTPError, httpx.InvalidURL, OSError, ValueError) as trouble:
            if not status:
                return f"{type(trouble).__name__}: {trouble}"
        return None if 200 <= status < 300 else f"HTTP {status}"

    async def close(self) -> None:
        """Close all connections."""
        with suppress(httpx.HTTPError, OSError):
            await self._client.aclose()


async def _drain(response: httpx.Response) -> None:
    """Let the rest go by, so that the connection can be used again; too much of it ends it."""
    left = DRAIN_BYTES_MAX
    async for piece in response.aiter_raw():
        left -= len(piece)
        if left < 0:
            return
