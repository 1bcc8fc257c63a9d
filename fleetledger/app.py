"""Composition root of the core process: opens everything in order, and closes it in reverse."""

import asyncio
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from ssl import SSLContext
from threading import Event as Flag
from typing import Any

import msgspec
import structlog
from prometheus_client import REGISTRY, Gauge
from starlette.types import ASGIApp

import commands.api.m4
import commands.api.scenes
import projections.api.m4
import projections.api.rdscore
import projections.api.sql
import projections.api.wsm
import replay.api
from commands.answers import SetAnswersWindow
from commands.api.m4_scene_config import wire
from commands.handle import Handler
from commands.imports.scene_json import read_scene
from commands.resources import LapseMapResources
from commands.scenes import ImportScene, scene_digest
from fleetledger.access import api as access_api
from fleetledger.access.file import FIRST_APP
from fleetledger.access.service import Access
from fleetledger.analyst import Analyst
from fleetledger.api import build
from fleetledger.callbacks import Callbacks
from fleetledger.clock import Clock, keep_time, kept_time_ms, wall_ms, warn_if_ahead
from fleetledger.collector import collect_when_idle, tame
from fleetledger.config import Auth, Settings
from fleetledger.disk_guard import MB, DiskGuard
from fleetledger.durability import Durability
from fleetledger.ending import Ending
from fleetledger.http import ThinRoute
from fleetledger.intake import Intake, telemetry_log
from fleetledger.listening import free_port, served, tls_of
from fleetledger.new_id import new_id
from fleetledger.processes import children_of
from fleetledger.proposing import responder
from fleetledger.rebuild_bar import RebuildBar
from fleetledger.sealer import Sealer
from fleetledger.secrets import Secrets
from fleetledger.start_check import check_folder, open_ledger, usable
from fleetledger.traffic_figures import TrafficFigures
from ledger.bus import LAST_KEY, PROPOSE_KEY
from ledger.errors import LedgerError, Refused
from ledger.events import AnyEvent
from ledger.feed import BEAT_S, FeedServer
from ledger.ids import CommandId, RobotName, SceneId
from ledger.moment import At
from ledger.snapshot import Snapshotter, restore
from ledger.state import Fleet
from ledger.store import FileLedger
from ledger.telemetry_read import last_plans, last_reports, plans_at, reports_at
from ledger.zenoh_bus import LOOPBACK, ZenohBus
from projections.api.m4_resources import external_map_res
from projections.api.m4_scene_query import Beside, SceneQueries
from projections.api.rdscore_status import past_of
from projections.claims import WAIT_S as CLAIM_WAIT_S
from projections.claims import ClaimWatch
from projections.devices import door_reports, lift_reports
from projections.find import Find
from projections.history import History
from projections.live import Live
from projections.reading import Reader
from projections.shared import Shared
from projections.story import Stories
from replay.moment import Moments
from replay.source import Source

log = structlog.get_logger()

POSITION = Gauge("fleetledger_ledger_position", "Newest position on disk")
HISTORY = Gauge("fleetledger_history_position", "Newest position in DuckDB; 0 while it is opened")
HISTORY_LAG = Gauge("fleetledger_history_lag_events", "Events that DuckDB does not have yet")
LIVE_ORDERS = Gauge("fleetledger_live_orders", "Orders not finished")
CLAIM_WAIT_REAL_S_MIN = 0.5  # for the scheduler's own pace, however fast the clock is
SWITCH_S = 0.0005  # the committer, back from the disk, would wait 5 ms for a busy event loop
GIVE_WAY_S = 0.002
COPY_S_MAX = 5.0  # a loop that is stopping answers nobody


class Core:
    """What the core process holds while it runs."""

    def __init__(self, settings: Settings, loop: asyncio.AbstractEventLoop) -> None:
        """Open the ledger and fold it; raises LedgerError where that cannot be."""
        self._settings = settings
        self._loop = loop
        check_folder(settings)
        self.ledger = open_ledger(settings)
        self.guard = DiskGuard(self.ledger, settings.ledger, settings.disk_reserve_mb * MB)
        self.guard.check()
        fleet = restore(settings.ledger, settings.snapshots)
        self.secrets = Secrets(settings.data)
        kept_ms = kept_time_ms(settings.data)
        self.clock = Clock.start(max(fleet.at_ms + 1, kept_ms), settings.speed)
        warn_if_ahead(self.clock, fleet.at_ms, settings.data)
        self.handler = Handler(fleet, self.guard, self.clock.now_ms, new_id)
        self.live = Live(fleet.copy())
        wait_s = max(CLAIM_WAIT_S / settings.speed, CLAIM_WAIT_REAL_S_MIN)
        self.claims = ClaimWatch(self.live.fleet.claims, wait_s)
        bar = RebuildBar()
        self.history = History(
            settings.data / "history.duckdb", self.live, bar.advance, self._give_way
        )
        HISTORY.set_function(lambda: self.history.position)
        HISTORY_LAG.set_function(lambda: max(0, self.history.newest - self.history.position))
        self.callbacks = Callbacks(settings.data, self.handler, self.ledger, self.secrets)
        self.reader = Reader(self.history.cursor, self.history.damaged)
        self.durability = Durability(loop, self.ledger.durable, self._apply)
        self.ledger.listen(self.durability.heard)
        self.ledger.rouse_by(self.durability.gather)
        self.moments = Moments(settings.data, read=self.ledger.read)
        self.find = Find(self.live, self.reader, self._fleet_then, self.clock.now_ms)
        self.analyst = Analyst(settings, lambda: self.live.position)
        self._closing = Flag()
        self._snapshotter = Snapshotter(settings.snapshots, settings.snapshot_events)
        self._snapshot: asyncio.Task[object] | None = None

    def _fleet_then(self, at_ms: int) -> Fleet:
        return self.moments.fleet(At(at_ms=at_ms))

    def _give_way(self) -> None:
        """Let go of the interpreter while clients wait for the disk; for threads of our own.

        A client's call lets go of it several times, and each time would wait up to SWITCH_S to get
        it back from a thread that goes on working: 30 ms a call at 32 connections (measured).
        """
        if not self.durability.idle:
            self._closing.wait(GIVE_WAY_S)

    def _apply(self, events: Sequence[AnyEvent]) -> None:
        self.live.apply(events)
        self.claims.apply(events)
        self.history.follow(events)
        POSITION.set(self.live.position)
        LIVE_ORDERS.set(len(self.live.fleet.orders))
        idle = self._snapshot is None or self._snapshot.done()
        if idle and not self.guard.low and self._snapshotter.due(self.live.position):
            write = partial(self._snapshotter.keep, self.live.fleet.copy(), self._give_way)
            self._snapshot = self._loop.create_task(asyncio.to_thread(write))

    async def keep_gateway_secrets(self, scene: SceneId, secrets: Mapping[RobotName, str]) -> None:
        """Keep what robots' gateways ask for; on disk when this returns."""
        await self.secrets.keep({f"gateway/{scene}/{name}": s for name, s in secrets.items()})

    def logs_messages_of(self, scene: SceneId) -> bool:
        """Tell whether what robots of a scene say is to be kept; called on the event loop.

        What room is left is the ledger's.
        """
        if self.guard.low:
            return False
        found = self.live.fleet.scenes.get(scene)
        return found is None or not found.config.robot_message_log_off

    def visible_fleet(self) -> Fleet:
        """Give a copy of what queries see; called on the bus's threads."""

        async def copy() -> Fleet:
            return self.live.fleet.copy()

        return asyncio.run_coroutine_threadsafe(copy(), self._loop).result(COPY_S_MAX)

    async def import_scene(self, path: Path) -> None:
        """Take a scene file in; the same content again changes nothing."""
        try:
            file = read_scene(path.read_bytes())
        except Refused as trouble:
            raise Refused(trouble.code, f"{path}: {trouble.message}", *trouble.arguments) from None
        command = ImportScene(
            id=CommandId(new_id()),
            by="serve",
            at_ms=self.clock.now_ms(),
            scene=SceneId(new_id()),
            digest=scene_digest(file),
            file=file,
        )
        decision = self.handler.handle(command)
        await self.durability.reached(decision.position)
        log.info("scene", id=decision.made, name=file.name, events=len(decision.events))

    async def begin(self) -> None:
        """Give up the ground that callers from before this start had asked for, for they have gone;
        tell the ledger how long answers are to be kept, where that has changed."""
        head: Any = {"by": "serve", "at_ms": self.clock.now_ms()}
        self.handler.handle(LapseMapResources(id=CommandId(new_id()), **head))
        window = SetAnswersWindow(
            id=CommandId(new_id()),
            count_max=self._settings.answers_max,
            age_s_max=self._settings.answers_age_s,
            **head,
        )
        await self.durability.reached(self.handler.handle(window).position)

    def failed(self, failure: LedgerError) -> None:
        """Hear that the ledger takes nothing more; called on the committer's thread."""
        self.durability.failed(failure)
        self.guard.failed(failure)
        self._loop.call_soon_threadsafe(lambda: self.handler.fall_back(self.live.fleet))

    async def close(self) -> None:
        """Write what is queued, keep a snapshot for a quick start, and let the folder go."""
        self._closing.set()
        await self.analyst.close()
        if self._snapshot is not None:
            await self._snapshot
        await asyncio.to_thread(self.callbacks.close)
        await asyncio.to_thread(self.ledger.close)
        self.reader.close()
        self.history.close()
        if self.live.position > 0:
            self._snapshotter.keep(self.live.fleet)


async def run(settings: Settings, stop: asyncio.Event, ready: Callable[[str, int], None]) -> int:
    """Serve until told to stop, or until the ledger fails; gives the exit code.

    `ready` is called with host and port once requests are answered.
    """
    loop = asyncio.get_running_loop()
    tls = tls_of(settings)
    core = Core(settings, loop)
    ending = Ending(loop, stop, settings.failure_grace_s, core.failed)
    core.ledger.on_failure(ending.failed)
    async with AsyncExitStack() as stack:
        stack.push_async_callback(core.close)
        fleet_at = partial(_fleet_at, settings, core.ledger)
        await asyncio.to_thread(core.history.start, core.ledger.read, fleet_at)
        live = core.live
        with usable(settings.data):
            await asyncio.to_thread(core.callbacks.start, core.ledger.read, fleet_at, live.fleet)
        for path in settings.scene:
            await core.import_scene(path)
        await core.begin()
        for scene in tuple(live.fleet.scenes):
            reports = await asyncio.to_thread(last_reports, settings.telemetry, scene)
            live.recall(reports, await asyncio.to_thread(last_plans, settings.telemetry, scene))
        telemetry = telemetry_log(settings)
        stack.callback(telemetry.close)
        endpoint = f"{LOOPBACK}:{settings.feed_port or free_port()}"
        bus = ZenohBus(endpoint, ())
        stack.callback(bus.close)
        intake = Intake(
            bus,
            loop,
            telemetry,
            live.observe,
            live.intend,
            core.logs_messages_of,
            live.devices,
            core.clock.now_ms,
        )
        figures = TrafficFigures(live.plans, core.clock.now_ms)
        figures.hear(bus)
        REGISTRY.register(figures)
        stack.callback(REGISTRY.unregister, figures)
        intake.start()
        stack.callback(intake.stop)
        _feed(stack, core, bus)
        bus.respond(PROPOSE_KEY, responder(core.handler, core.ledger))
        bus.respond(LAST_KEY, lambda _: (msgspec.json.encode(live.last()),))
        access = await _access(stack, core, settings)
        app = _api(core, settings, access)
        port = await stack.enter_async_context(served(app, settings.host, settings.port, tls))
        await _serve_rdscore(stack, core, settings, tls)
        for child in children_of(settings, core.clock, endpoint):
            await child.start()
            stack.push_async_callback(child.stop)
        tame()
        sys.setswitchinterval(SWITCH_S)
        sealer = Sealer(settings.data, lambda: core.guard.low)
        stack.push_async_callback(sealer.stop)
        for looking_after in (
            collect_when_idle(lambda: core.durability.idle),
            keep_time(settings.data, core.clock),
            core.guard.watch(),
            sealer.run(),
        ):
            stack.callback(asyncio.create_task(looking_after).cancel)
        stack.callback(core.callbacks.ask_to_stop)
        ready(settings.host, port)
        await stop.wait()
        log.info("stopping", position=core.live.position)
    return ending.exit_code


def _fleet_at(settings: Settings, ledger: FileLedger, position: int) -> Fleet:
    return restore(settings.ledger, settings.snapshots, position=position, read=ledger.read)


def _feed(stack: AsyncExitStack, core: Core, bus: ZenohBus) -> None:
    """Serve the ledger to followers, and tell them where it is also when nothing happens."""
    feed = FeedServer(bus, core.ledger, core.visible_fleet)

    async def beat() -> None:
        while True:
            await asyncio.sleep(BEAT_S)
            await asyncio.to_thread(feed.beat)  # it may wait for the committer

    beating = asyncio.create_task(beat())
    stack.callback(beating.cancel)


async def _access(stack: AsyncExitStack, core: Core, settings: Settings) -> Access:
    """Open access, look after it while serving, and make a key where nobody may call yet."""
    access = Access(
        settings.data,
        enforced=settings.auth is not Auth.NONE,
        handler=core.handler,
        durable=core.durability.reached,
        now_ms=wall_ms,
    )
    if access.enforced and (new_key := access.file.first_key()) is not None:
        log.warning(
            "first start: keep this key pair, it is not shown again",
            **{"xyy-app-id": FIRST_APP, "xyy-app-key": new_key},
        )
    await access.tell_changes()
    stack.push_async_callback(access.close)
    watching = asyncio.create_task(access.watch())
    stack.callback(watching.cancel)
    return access


def _api(core: Core, settings: Settings, access: Access) -> ASGIApp:
    find = core.find
    queries = SceneQueries(
        find,
        partial(reports_at, settings.telemetry),
        partial(plans_at, settings.telemetry),
        Beside(
            config=wire,
            doors=door_reports,
            lifts=lift_reports,
            map_resources=external_map_res,
        ),
        Shared(lambda: core.live.position, asyncio.get_running_loop().time),
    )
    stories = Stories(core.history, core.live, core.ledger.read)
    source = Source(
        settings.data,
        core.moments,
        now_ms=core.clock.now_ms,
        live=lambda: core.live.fleet,
        comes=core.live.wait,
        reports=core.live.reports,
        plans=core.live.plans,
        story=stories.story,
        finished=stories.finished,
    )
    routers = (
        access_api.router(access),
        commands.api.m4.router(
            core.handler,
            core.durability.reached,
            ThinRoute,
            core.keep_gateway_secrets,
            core.claims.granted,
        ),
        commands.api.scenes.router(core.handler, core.durability.reached, ThinRoute, find.fleet),
        projections.api.m4.router(queries, ThinRoute),
        projections.api.wsm.router(queries),
        replay.api.router(source, ThinRoute),
        projections.api.sql.router(core.analyst.ask, ThinRoute),
        *core.callbacks.routers(core.durability.reached, core.live.fleet.scenes.get),
    )
    return build(
        routers,
        callers=access.callers,
        refused=access.refusals.refused,
        position=lambda: core.live.position,
        wait=core.live.wait,
        when=core.durability.when,
    )


async def _serve_rdscore(
    stack: AsyncExitStack, core: Core, settings: Settings, tls: SSLContext | None
) -> None:
    """Serve RDSCore's HTTP on its port and its WebSocket one higher, as 8088 and 8089 are."""
    if settings.rdscore_port is None:
        return
    telemetry = (partial(reports_at, settings.telemetry), partial(plans_at, settings.telemetry))
    past = partial(past_of, core.find, *telemetry)
    app = projections.api.rdscore.app(core.live, core.clock.now_ms, past=past)
    http = await stack.enter_async_context(served(app, settings.host, settings.rdscore_port, tls))
    ws = 0 if settings.rdscore_port == 0 else settings.rdscore_port + 1
    websocket = await stack.enter_async_context(served(app, settings.host, ws, tls))
    log.info("rdscore dialect", http_port=http, websocket_port=websocket)
