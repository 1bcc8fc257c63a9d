"""Draws frames, maps and stories from a source: live ones on the loop, past ones beside it."""

import asyncio
from collections.abc import Mapping, Sequence

from ledger.errors import Refused
from ledger.ids import OrderId, RobotName, SceneId, robot_key
from ledger.link import Plan, Report
from ledger.moment import At
from ledger.scene import Scene
from ledger.state import Fleet, Order
from ledger.waits import awaited, cycles
from replay.frame import Frame, MapFrame, Wish, build
from replay.source import Source
from replay.story import Story, tell
from replay.waiting import Waiting

FINISHED_MAX = 500  # ended orders among which the newest wanted ones are looked for


class Unknown(Refused):
    """What was asked for does not exist, or did not at that moment."""

    status = 404


def _scene(fleet: Fleet, scene: SceneId | None) -> Scene | None:
    """Give the scene asked for, or the first."""
    if scene is None:
        return next((s for s in fleet.scenes.values() if not s.disabled), None)
    return fleet.scenes.get(scene)


async def frame_at(
    source: Source, scene: SceneId | None, as_of_ms: int | None, wish: Wish
) -> Frame:
    """Draw a moment; None = now. A moment that lies ahead is drawn as now.

    A scene that did not exist then is drawn empty: the slider may be dragged before its import.
    """
    now_ms = source.now_ms()
    first_ms = await asyncio.to_thread(source.first_ms)
    if as_of_ms is None or as_of_ms >= now_ms:
        return await _live_frame(source, scene, now_ms, first_ms, wish)

    def past() -> Frame:
        fleet = source.moments.fleet(At(at_ms=as_of_ms))
        drawn = _scene(fleet, scene)
        reports: Mapping[RobotName, Report] = {}
        plans: Mapping[RobotName, Plan] = {}
        finished: Sequence[Order] = ()
        if drawn is not None and wish.limit:
            finished = source.finished(drawn.id, fleet.position, FINISHED_MAX)
        if drawn is not None:
            reports = source.reports_at(drawn.id, as_of_ms)
            plans = source.plans_at(drawn.id, as_of_ms)
        return build(
            fleet,
            drawn,
            at_ms=as_of_ms,
            now_ms=now_ms,
            live=False,
            first_ms=first_ms,
            report=reports.get,
            plan=plans.get,
            finished=finished,
            wish=wish,
        )

    return await asyncio.to_thread(past)


async def _live_frame(
    source: Source,
    scene: SceneId | None,
    now_ms: int,
    first_ms: int | None,
    wish: Wish,
) -> Frame:
    drawn = _scene(source.live(), scene)
    if drawn is None and scene is not None:
        raise Unknown("errSceneUnknown", f"Field 'sceneId' is wrong: no scene '{scene}'.", scene)
    position = source.live().position
    finished = (
        await asyncio.to_thread(source.finished, drawn.id, position, FINISHED_MAX)
        if drawn and wish.limit
        else ()
    )

    def report(robot: RobotName) -> Report | None:
        return source.reports.get(robot_key(drawn.id, robot)) if drawn else None

    def plan(robot: RobotName) -> Plan | None:
        return source.plans.get(robot_key(drawn.id, robot)) if drawn else None

    return build(
        source.live(),
        drawn,
        at_ms=now_ms,
        now_ms=now_ms,
        live=True,
        first_ms=first_ms,
        report=report,
        plan=plan,
        finished=finished,
        wish=wish,
    )


async def waiting_at(source: Source, scene: SceneId | None, as_of_ms: int | None) -> Waiting:
    """Say who waits for whom at a moment."""
    frame = await frame_at(source, scene, as_of_ms, Wish())
    return Waiting(
        at_ms=frame.at_ms,
        live=frame.live,
        position=frame.position,
        scene=frame.scene,
        waits=frame.waits,
        chains=frame.chains,
        cycles=tuple(cycles({w.robot: awaited(w.reason, w.blockers) for w in frame.waits})),
    )


async def map_at(
    source: Source, scene: SceneId | None, as_of_ms: int | None
) -> tuple[MapFrame, int]:
    """Draw a scene's map as it was, and say at which position."""
    if as_of_ms is None or as_of_ms >= source.now_ms():
        fleet = source.live()
    else:
        fleet = await asyncio.to_thread(source.moments.fleet, At(at_ms=as_of_ms))
    drawn = _scene(fleet, scene)
    if drawn is None:
        name = scene or ""
        raise Unknown("errSceneUnknown", f"Field 'sceneId' is wrong: no scene '{name}' then.", name)
    frame = MapFrame(
        scene=drawn.id,
        name=drawn.name,
        digest=drawn.digest,
        areas=drawn.areas,
        groups=drawn.groups,
    )
    return frame, fleet.position


async def story_at(source: Source, order: OrderId, as_of_ms: int | None) -> Story:
    """Tell an order's story up to a moment."""
    events = await asyncio.to_thread(source.story, order)
    told = tell(order, events, as_of_ms)
    if told is None:
        words = f"Field 'orderId' is wrong: there is no order '{order}'"
        words += "." if as_of_ms is None else " at that moment."
        raise Unknown("errOrderUnknown", words, order)
    return told
