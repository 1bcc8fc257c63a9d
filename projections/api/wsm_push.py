"""Scenes pushed to those who subscribe: a snapshot, then ten deltas a second, numbered.

A frame is made once for all clients who want the same fields. Whoever has not taken the last frame
yet is passed over and gets a snapshot next; nothing is queued for anybody. Snapshots are big, so of
each scene one a second is made at most, for all who wait for one.
"""

import asyncio
from collections.abc import Callable
from typing import Protocol

import msgspec
import structlog

from ledger.errors import Refused
from ledger.ids import SceneId
from projections.api.scene_changes import Fragments, SceneChanges
from projections.api.wsm_frames import BAD_REQUEST, Frame, encoded, escaped, refusal

TICK_S = 0.1
SNAPSHOT_EVERY_TICKS = 10
QUIET_TICKS = 10  # after so many without any change an empty delta says that all is well
SNAPSHOT = "Fleetledger::Scene::Snapshot"
DELTA = "Fleetledger::Scene::Delta"
SUBSCRIBE = "Fleetledger::Scene::Subscribe"
SCENES_MAX = 50  # followed at once

log = structlog.get_logger()


class Listener(Protocol):
    """A client, as far as frames are pushed to it."""

    def ready(self) -> bool:
        """Whether it has taken the last frame."""

    def push(self, text: str) -> None:
        """Send a frame without waiting; only if `ready`."""


class _Subscription:
    """What one client follows of one scene."""

    def __init__(self, fields: frozenset[str]) -> None:
        self.fields = fields
        self.behind = True  # needs a snapshot


class Channel:
    """One scene and all who follow it."""

    def __init__(self, scene: SceneId, changes: SceneChanges) -> None:
        """Take the scene and what looks at it."""
        self._scene = scene
        self._changes = changes
        self._following: dict[Listener, _Subscription] = {}
        self._seq = 0
        self._quiet = 0
        self._since_snapshot = SNAPSHOT_EVERY_TICKS

    def join(self, listener: Listener, fields: frozenset[str]) -> None:
        """Follow, or follow other fields, from a snapshot on."""
        self._following[listener] = _Subscription(fields)

    def leave(self, listener: Listener) -> bool:
        """Follow no longer; True if nobody is left."""
        self._following.pop(listener, None)
        return not self._following

    def follows(self, listener: Listener) -> bool:
        """Tell whether this client follows the scene."""
        return listener in self._following

    def resync(self, listener: Listener) -> None:
        """Give this client a snapshot next."""
        self._following[listener].behind = True

    def resync_all(self) -> None:
        """Give everybody a snapshot next: a look has failed, and may have lost changes."""
        for following in self._following.values():
            following.behind = True

    def tick(self, position: int) -> None:
        """Look at the scene, and send what has changed; raises Refused once it is gone."""
        wanted = frozenset[str]().union(*(s.fields for s in self._following.values()))
        instant_before = self._changes.instant_ms
        found = self._changes.look(wanted)
        self._quiet += 1
        self._since_snapshot += 1
        changed = bool(found) or self._changes.instant_ms != instant_before
        if changed or self._quiet >= QUIET_TICKS:
            self._quiet = 0
            self._seq += 1
            self._send(found, position)
        elif self._snapshot_due():
            self._send_snapshots(position)

    def _snapshot_due(self) -> bool:
        if self._since_snapshot < SNAPSHOT_EVERY_TICKS:
            return False
        return any(s.behind and who.ready() for who, s in self._following.items())

    def _send(self, found: Fragments, position: int) -> None:
        deltas: dict[frozenset[str], str] = {}
        for listener, following in self._following.items():
            if following.behind:
                continue
            if not listener.ready():
                following.behind = True
                continue
            delta = deltas.get(following.fields)
            if delta is None:
                some = {name: part for name, part in found.items() if name in following.fields}
                delta = deltas[following.fields] = self._frame(DELTA, some, position)
            listener.push(delta)
        if self._snapshot_due():
            self._send_snapshots(position)

    def _send_snapshots(self, position: int) -> None:
        self._since_snapshot = 0
        snapshots: dict[frozenset[str], str] = {}
        for listener, following in self._following.items():
            if not following.behind or not listener.ready():
                continue
            text = snapshots.get(following.fields)
            if text is None:
                whole = self._changes.whole(sorted(following.fields))
                text = snapshots[following.fields] = self._frame(SNAPSHOT, whole, position)
            following.behind = False
            listener.push(text)

    def _frame(self, action: str, fragments: Fragments, position: int) -> str:
        content = {
            "sceneId": self._scene,
            "seq": self._seq,
            "position": position,
            "rTime": self._changes.instant_ms,
        } | {name: msgspec.Raw(part) for name, part in fragments.items()}
        return encoded(action, escaped(msgspec.json.encode(content)))

    def close(self, trouble: Refused) -> None:
        """Tell all that there is nothing more to follow."""
        frame = Frame(action=SUBSCRIBE)
        text = refusal(frame, BAD_REQUEST, trouble.code, trouble.message, trouble.arguments)
        for listener in self._following:
            if listener.ready():
                listener.push(text)


class Push:
    """All scenes that are followed, each with a ticker while somebody follows it."""

    def __init__(
        self,
        follow: Callable[[SceneId], SceneChanges],
        position: Callable[[], int],
        tick_s: float = TICK_S,
    ) -> None:
        """Take what makes a look at a scene, the readable position, and the pace of the wall."""
        self._follow = follow
        self._position = position
        self._tick_s = tick_s
        self._channels: dict[SceneId, Channel] = {}
        self._tickers: dict[SceneId, asyncio.Task[None]] = {}

    @property
    def followed(self) -> int:
        """Number of scenes that somebody follows."""
        return len(self._channels)

    def followed_by(self, listener: Listener) -> int:
        """Number of scenes that this client follows."""
        return sum(channel.follows(listener) for channel in self._channels.values())

    def subscribe(self, listener: Listener, scene: SceneId, fields: frozenset[str]) -> None:
        """Let a client follow a scene that there is."""
        channel = self._channels.get(scene)
        if channel is None:
            if len(self._channels) >= SCENES_MAX:
                words = f"{SCENES_MAX} scenes are followed already."
                raise Refused("errTooManyScenes", words, SCENES_MAX)
            channel = self._channels[scene] = Channel(scene, self._follow(scene))
            self._tickers[scene] = asyncio.create_task(self._tick(scene, channel))
        channel.join(listener, fields)

    def resync(self, listener: Listener, scene: SceneId) -> bool:
        """Give a client a snapshot next; False if it does not follow the scene."""
        channel = self._channels.get(scene)
        if channel is None or not channel.follows(listener):
            return False
        channel.resync(listener)
        return True

    def unsubscribe(self, listener: Listener, scene: SceneId) -> bool:
        """Let a client follow a scene no longer; False if it did not."""
        channel = self._channels.get(scene)
        if channel is None or not channel.follows(listener):
            return False
        if channel.leave(listener):
            self._forget(scene)
        return True

    def leave(self, listener: Listener) -> None:
        """Forget a client that has gone."""
        for scene in tuple(self._channels):
            self.unsubscribe(listener, scene)

    def _forget(self, scene: SceneId) -> None:
        del self._channels[scene]
        self._tickers.pop(scene).cancel()

    async def _tick(self, scene: SceneId, channel: Channel) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            try:
                channel.tick(self._position())
            except Refused as trouble:
                channel.close(trouble)
                if self._channels.get(scene) is channel:
                    del self._channels[scene]
                    del self._tickers[scene]
                return
            except Exception as trouble:  # the next look may do better
                log.exception("no frame", scene=scene, reason=str(trouble))
                channel.resync_all()
            due = max(due + self._tick_s, loop.time())  # what was missed is not made up for
            await asyncio.sleep(due - loop.time())
