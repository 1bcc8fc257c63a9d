"""What can be asked by a frame of `/wsm`, each by its action (spec/m4.md §3, §6)."""

from collections.abc import Awaitable, Callable
from typing import TypeAlias

import msgspec

from ledger.link import Plan
from projections.api.answers import QUESTION_BYTES_MAX, ROBOTS_AGE_S_MAX, parsed
from projections.api.m4 import detail_of
from projections.api.m4_models import OrderAsked, ReportsAsked, SceneAsked
from projections.api.m4_robots import (
    Seen,
    load_row,
    orders_of,
    rounded,
    spaces,
    target_point,
    ui_report,
)
from projections.api.m4_scene_query import FIELDS, SEED_FIELDS, SceneQueries
from projections.api.m4_scenes import scene_asked
from projections.api.wsm_frames import Frame, content_of, escaped
from projections.fields import Row

Answering: TypeAlias = Callable[[Frame], Awaitable[bytes]]  # gives the JSON of the content


class Actions:
    """Answers the questions."""

    def __init__(self, queries: SceneQueries) -> None:
        """Take who answers the same over HTTP."""
        self._queries = queries
        self.known: dict[str, Answering] = {
            "Fleet::OrderDetail": self._order,
            "Fleet::OrderDetail::Query": self._order,
            "Fleet::Scene": self._scene,
            "Fleet::Scene::Query": self._scene_of_seed,
            "Fleet3::AllRobotsUiReports::Query": self._reports,
            "Fleet3::RobotsPositionOnly::Query": self._positions,
        }

    async def answer(self, frame: Frame) -> str:
        """Give the content of the answer, escaped; alike questions of many are answered once."""

        async def fresh() -> str:
            return escaped(await self.known[frame.action](frame))

        shared = self._queries.shared
        if shared is None or len(frame.content) > QUESTION_BYTES_MAX:
            return await fresh()
        return await shared.give((frame.action, frame.content), ROBOTS_AGE_S_MAX, fresh)

    async def _order(self, frame: Frame) -> bytes:
        asked = content_of(frame, OrderAsked)
        row, _ = await detail_of(self._queries.find, asked.order_id, parsed(asked.as_of))
        return msgspec.json.encode(row)

    async def _scene(self, frame: Frame) -> bytes:
        return await self._scene_with(frame, FIELDS)

    async def _scene_of_seed(self, frame: Frame) -> bytes:
        return await self._scene_with(frame, SEED_FIELDS)

    async def _scene_with(self, frame: Frame, fields: tuple[str, ...]) -> bytes:
        asked = content_of(frame, SceneAsked)
        at_ms = parsed(asked.as_of)
        reply, _ = await self._queries.answer(asked.scene_id, asked, at_ms, fields)
        return msgspec.json.encode(reply)

    async def _reports(self, frame: Frame) -> bytes:
        seen = await self._seen(content_of(frame, ReportsAsked))
        return msgspec.json.encode({s.robot.name: ui_report(s, raw=False) for s in seen})

    async def _positions(self, frame: Frame) -> bytes:
        asked = content_of(frame, ReportsAsked)
        seen = await self._seen(asked)
        at_ms = parsed(asked.as_of)
        reply = {
            "robots": {s.robot.name: position_row(s) for s in seen},
            "replyTimestamp": self._queries.find.now_ms() if at_ms is None else at_ms,
        }
        return msgspec.json.encode(reply)

    async def _seen(self, asked: ReportsAsked) -> tuple[Seen, ...]:
        at_ms = parsed(asked.as_of)
        fleet = await self._queries.find.fleet(at_ms)
        scene = scene_asked(fleet, asked.scene_id, None)
        return await self._queries.seen(fleet, scene, at_ms)


def position_row(seen: Seen) -> Row:
    """Give where a robot is and goes (spec/protocols.md §1.5).

    Reading: the ways are path keys, as in `UiRobotReport`; those driven already are not kept.
    """
    plan: Plan | None = seen.plan
    ways = list(plan.untravelled) if plan is not None else []
    row: Row = {"travelled": [], "unTravelled": ways, "remainingPaths": ways}
    row["spaces"] = spaces(plan)
    report = seen.report
    row["loads"] = [load_row(load, seen.group) for load in report.loads] if report else []
    if report is not None:
        row |= {"x": rounded(report.x_m, 1e3), "y": rounded(report.y_m, 1e3)}
        row["d"] = rounded(report.heading_rad, 1e4)
    target = target_point(orders_of(seen.robot, seen.orders), plan, seen.points)
    if target is not None:
        row["targetPoint"] = target
    return row
