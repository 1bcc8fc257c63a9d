"""Callbacks of a core: the outbox that keeps them, the thread that sends them, and their calls."""

import secrets
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random

from fastapi import APIRouter
from prometheus_client import Gauge

import commands.api.callbacks
import projections.api.callbacks
from commands.api.answering import Durable
from commands.api.callbacks import secret_name
from commands.callbacks import GiveUpCallback
from commands.handle import Handler
from fleetledger.callback_post import Post
from fleetledger.callback_sender import Sender
from fleetledger.clock import wall_ms
from fleetledger.http import ThinRoute
from fleetledger.secrets import Secrets
from ledger.errors import Unknown
from ledger.ids import CommandId, SceneId
from ledger.scene import Scene
from ledger.state import Fleet
from ledger.store import Ledger
from projections.callbacks import Callback
from projections.outbox import FleetAt, Outbox, Read

FILE_NAME = "outbox.sqlite"
AUTHOR = "callbacks"  # of what is given up
WAIT_S = 10.0  # for the disk
SECRET_BYTES = 32

WAITING = Gauge("fleetledger_callbacks_waiting", "Callbacks still to be delivered")
BEHIND = Gauge("fleetledger_callbacks_behind", "Events that the outbox has not looked at yet")


class Callbacks:
    """What tells others of the orders' states."""

    def __init__(self, data: Path, handler: Handler, ledger: Ledger, kept: Secrets) -> None:
        """Take the data folder, who decides, the ledger, and where secrets are kept."""
        self._handler = handler
        self._ledger = ledger
        self._secrets = kept
        connect = partial(Post, self._secret, wall_ms)
        chance = Random(secrets.randbits(64))
        self.sender = Sender(connect, self._give_up, self._wanted, chance)
        self.outbox = Outbox(data / FILE_NAME, self.sender.hear)
        ledger.listen(self.outbox.follow)
        WAITING.set_function(lambda: self.outbox.count)
        BEHIND.set_function(lambda: self.outbox.behind)

    def start(self, read: Read, fleet_at: FleetAt, fleet: Fleet) -> None:
        """Follow the ledger, whose newest state is given, and send; before any command comes."""
        self.sender.start(self.outbox)
        self.outbox.start(read, fleet_at, fleet)

    def routers(
        self, durable: Durable, scene_of: Callable[[SceneId], Scene | None]
    ) -> tuple[APIRouter, APIRouter]:
        """Give the calls that change settings, and the one that shows what waits."""
        return (
            commands.api.callbacks.router(
                self._handler,
                durable,
                ThinRoute,
                self._secrets,
                partial(secrets.token_urlsafe, SECRET_BYTES),
            ),
            projections.api.callbacks.router(
                scene_of, self.outbox.waiting, lambda: self.outbox.behind, ThinRoute
            ),
        )

    def ask_to_stop(self) -> None:
        """Send nothing more; returns at once."""
        self.sender.ask_to_stop()

    def close(self) -> None:
        """Wait for tries under way, and note what came of them: at most three seconds."""
        self.sender.ask_to_stop()
        self.sender.join()
        self.outbox.close()

    def _secret(self, scene: SceneId) -> str | None:
        return self._secrets.get(secret_name(scene))

    def _wanted(self, callback: Callback) -> bool:
        scene = self._handler.fleet.scenes.get(callback.scene)
        return scene is not None and callback.url in scene.callbacks.urls

    def _give_up(self, callback: Callback) -> None:
        """State in the ledger that the receiver has missed it; on disk when this returns."""
        handler = self._handler
        command = GiveUpCallback(
            id=CommandId(handler.new_id()),
            by=AUTHOR,
            at_ms=handler.now_ms(),
            scene=callback.scene,
            order=callback.order,
            url=callback.url,
            status=callback.status,
            of_position=callback.position,
            reason=callback.error,
        )
        position = handler.handle(command).position
        if not self._ledger.wait(position, WAIT_S):
            raise Unknown(f"position {position} did not reach the disk in {WAIT_S} s")
