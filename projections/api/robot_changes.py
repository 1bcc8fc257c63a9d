"""What has changed of a scene's robots since the last look: only the fields that differ.

A thousand robots that all drive are looked at in some 8 ms: the figures that change
with every report are interpolated and rounded as arrays, and each other part of a row is made anew
only where its inputs are others than last time. The rows are those of `ui_report`, to the digit.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import chain
from operator import attrgetter, is_, itemgetter
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from ledger.ids import OrderId, RobotKey, RobotName
from ledger.link import Plan, Report
from ledger.scene import Group, Scene
from ledger.state import Fleet, Order, Robot
from projections.api.m4_robots import (
    EXACT_MAX,
    NUMBERS,
    bin_points,
    errand,
    identity,
    orders_of,
    said,
    traffic,
)
from projections.api.m4_seen import groups_of, instant_of, robots_of
from projections.fields import Row
from projections.live import Live
from projections.poses import around, at_instant

Changes: TypeAlias = dict[str, Any]  # by robot: field -> value, None = gone; None = robot gone
Figures: TypeAlias = npt.NDArray[np.float64]  # (n_robots, n_columns)
Between: TypeAlias = tuple[int, float, Report]  # place of the robot, part of the way, report after

_figures = attrgetter(*(field for _, field, _ in NUMBERS))
_MOVED = ("x_m", "y_m", "speed_mps", "turn_radps", "heading_rad")  # interpolated
_moved = attrgetter(*_MOVED)
_MOVED_COLUMNS = [[field for _, field, _ in NUMBERS].index(field) for field in _MOVED]
_SCALES = np.array([scale for _, _, scale in NUMBERS])
_NAMES = tuple(name for name, _, _ in NUMBERS)
_BITS = np.array([1 << n for n in range(len(NUMBERS))])

# all else of a report that rows show
_said = attrgetter(
    "area",
    "map_name",
    "map_digest",
    "controller",
    "emergency_stop",
    "soft_stop",
    "blocked",
    "blocked_reason",
    "charging",
    "point",
    "paused",
    "alarms",
    "loads",
    "action",
)
_ABSENT = object()


class Track:
    """One robot as it was shown last, and what its row was made of."""

    __slots__ = (
        "errand",
        "group",
        "identity",
        "known",
        "online",
        "own_ms",
        "plan",
        "report",
        "robot",
        "row",
        "said",
        "said_of",
        "traffic",
        "unseen",
    )

    def __init__(self, robot: Robot, group: Group) -> None:
        self.robot = robot
        self.group = group
        self.online = robot.online
        self.known: tuple[Order, ...] = ()
        self.plan: Plan | None = None
        self.report: Report | None = None
        self.said_of: tuple[Any, ...] | None = None
        self.own_ms: int | None = None  # when it was so; None = at the instant of all
        self.unseen = True
        self.row: Row = {}  # without figures and time
        self.identity: Row = {}
        self.said: Row = {}
        self.errand: Row = {}
        self.traffic: Row = {}


class RobotChanges:
    """Follows the enabled robots of one scene."""

    def __init__(self) -> None:
        self.instant_ms: int | None = None  # of all robots who answer
        self.plans_changed = True
        self._scene: Scene | None = None
        self._points: dict[str, str] = {}
        self._robots: dict[RobotKey, Robot] = {}  # disabled ones too
        self._tracks: dict[RobotKey, Track] = {}
        self._all_robots: list[Robot] = []  # of all scenes
        self._order_ids: list[OrderId] = []
        self._their_orders: list[Order | None] = []
        self._reporting: list[Track] = []
        self._figures: Figures = np.empty((0, len(NUMBERS)))

    def rows(self) -> dict[RobotName, Row]:
        """Give all robots as they were shown last."""
        found = {track.robot.name: dict(track.row) for track in self._tracks.values()}
        for track, figures in zip(self._reporting, self._figures.tolist(), strict=True):
            row = found[track.robot.name]
            row |= zip(_NAMES, figures, strict=True)
            row["rTime"] = self.instant_ms if track.own_ms is None else track.own_ms
        return found

    def shown(self) -> dict[RobotKey, Robot]:
        """Give the robots that clients see."""
        return {key: robot for key, robot in self._robots.items() if key in self._tracks}

    def look(self, live: Live, scene: Scene, *, moved: bool) -> Changes:
        """Give what has changed; `moved` tells whether the ledger has since the last look.

        `rTime` is named only for a robot whose own is not `instant_ms` as that of all who answer.
        """
        changes: Changes = {}
        self.plans_changed = moved and not self._as_before(live.fleet, scene)
        if self.plans_changed:
            self._follow(live.fleet.orders, scene, robots_of(live.fleet, scene), changes)
            self._all_robots = list(live.fleet.robots.values())
            self._order_ids = [id_ for robot in self._robots.values() for id_ in robot.orders]
            self._their_orders = [live.fleet.orders.get(id_) for id_ in self._order_ids]
        self.instant_ms = instant_of(live, self._robots)
        self._see(live, changes)
        return changes

    def _as_before(self, fleet: Fleet, scene: Scene) -> bool:
        """Tell whether robots and their orders are the same values: most events change neither.

        Lists of the same values are compared at a thousand in 10 µs.
        """
        return (
            scene is self._scene
            and list(fleet.robots.values()) == self._all_robots
            and [fleet.orders.get(id_) for id_ in self._order_ids] == self._their_orders
        )

    def _follow(
        self,
        orders: Mapping[OrderId, Order],
        scene: Scene,
        robots: dict[RobotKey, Robot],
        changes: Changes,
    ) -> None:
        """Take in what the ledger says of the robots."""
        anew = scene is not self._scene
        if anew:
            self._scene, self._points = scene, bin_points(scene)
        self._robots = robots
        shown = {key: robot for key, robot in robots.items() if not robot.config.disabled}
        for key in self._tracks.keys() - shown.keys():
            changes[self._tracks.pop(key).robot.name] = None
        groups = groups_of(scene)
        for key, robot in shown.items():
            known = orders_of(robot, orders) if robot.orders else ()
            track = self._tracks.get(key)
            if track is None:
                track = self._tracks[key] = Track(robot, groups[robot.config.group])
            elif track.robot is robot and _same(known, track.known) and not anew:
                continue
            track.robot, track.known, track.online = robot, known, robot.online
            track.group = groups[robot.config.group]
            change = _part(track, "identity", identity(robot, track.group))
            change |= self._report_parts(track)
            change |= self._plan_parts(track)
            if change:
                changes.setdefault(robot.name, {}).update(change)

    def _report_parts(self, track: Track) -> Row:
        return _part(track, "said", said(track.robot, track.group, track.report))

    def _plan_parts(self, track: Track) -> Row:
        report, plan = track.report, track.plan
        change = _part(track, "errand", errand(track.robot, track.known, report, plan))
        return change | _part(track, "traffic", traffic(track.known, report, plan, self._points))

    def _see(self, live: Live, changes: Changes) -> None:
        """Take in what robots report and traffic intends."""
        reporting: list[Track] = []
        befores: list[Report] = []
        between: list[Between] = []
        reports, recents, plans, instant_ms = live.reports, live.recent, live.plans, self.instant_ms
        for key, track in self._tracks.items():
            report, plan = reports.get(key), plans.get(key)
            change: Row = {}
            said_of = None
            if report is not None:
                own_ms: int | None = report.at_ms
                if track.online and instant_ms is not None:
                    report, own_ms = _brought(recents[key], instant_ms, len(befores), between)
                if own_ms is None:
                    if track.unseen:
                        change["rTime"] = instant_ms
                elif track.online or own_ms != track.own_ms or track.unseen:
                    change["rTime"] = own_ms
                track.own_ms, track.unseen = own_ms, False
                reporting.append(track)
                befores.append(report)
                said_of = _said(report)
            new_report = said_of != track.said_of
            if new_report or plan is not track.plan:
                change |= self._seen(track, report, said_of, plan, new_report=new_report)
            if change:
                changes.setdefault(track.robot.name, {}).update(change)
        self._changed_figures(reporting, _between(befores, between), changes)

    def _seen(
        self,
        track: Track,
        report: Report | None,
        said_of: tuple[Any, ...] | None,
        plan: Plan | None,
        *,
        new_report: bool,
    ) -> Row:
        """Make the parts anew whose inputs have changed."""
        new_plan = not _alike(plan, track.plan)
        self.plans_changed |= new_plan
        before = track.plan
        track.report, track.said_of, track.plan = report, said_of, plan
        if new_report:
            return self._report_parts(track) | self._plan_parts(track)
        if not new_plan:
            return {}
        if before is None or plan is None or before.moving != plan.moving:
            return self._plan_parts(track)
        return _part(track, "traffic", traffic(track.known, report, plan, self._points))

    def _changed_figures(self, reporting: list[Track], figures: Figures, changes: Changes) -> None:
        if not reporting:
            self._reporting, self._figures = reporting, figures
            return
        if reporting != self._reporting:
            self._reporting, self._figures = reporting, np.full(figures.shape, np.nan)
        masks = (figures != self._figures) @ _BITS
        self._figures = figures
        (places,) = masks.nonzero()
        moved = zip(places.tolist(), masks[places].tolist(), figures[places].tolist(), strict=True)
        for place, mask, row in moved:
            change = dict(zip(*_picked(mask, row), strict=True))
            name = reporting[place].robot.name
            known = changes.get(name)
            if known is None:
                changes[name] = change
            else:
                known.update(change)


def _same(one: tuple[Order, ...], other: tuple[Order, ...]) -> bool:
    """Whether these are the same values; comparing them field by field is not needed."""
    return len(one) == len(other) and all(map(is_, one, other))


def _alike(one: Plan | None, other: Plan | None) -> bool:
    """Whether two plans show the same: the scheduler repeats them now and then."""
    if one is None or other is None:
        return one is other
    return (
        one.commit == other.commit
        and one.moving == other.moving
        and one.ready == other.ready
        and one.target == other.target
        and one.untravelled == other.untravelled
        and one.blocked_by == other.blocked_by
        and one.alarm == other.alarm
        and one.wait == other.wait
        and one.spaces == other.spaces
    )


def _part(track: Track, part: str, now: Row) -> Row:
    """Put a part anew into the row; gives the fields that differ."""
    before: Row = getattr(track, part)
    change = {name: value for name, value in now.items() if before.get(name, _ABSENT) != value}
    for name in before.keys() - now.keys():
        change[name] = None
        del track.row[name]
    setattr(track, part, now)
    track.row.update((name, value) for name, value in change.items() if value is not None)
    return change


def _brought(
    recent: Sequence[Report], instant_ms: int, place: int, between: list[Between]
) -> tuple[Report, int | None]:
    """Give the last report until the instant, and note what is to be interpolated behind it.

    Beside it the time at which the robot is shown, None for the instant itself.
    """
    newest = recent[-1]
    if newest.at_ms == instant_ms:
        return newest, None
    before, after = around(recent, instant_ms)
    if before is None:
        return recent[0], recent[0].at_ms  # it joined just now
    if after is None or before.area != after.area:
        return at_instant(recent, instant_ms), None
    between.append((place, (instant_ms - before.at_ms) / (after.at_ms - before.at_ms), after))
    return before, None


def _picked(mask: int, row: list[float]) -> tuple[tuple[str, ...], Iterable[float]]:
    """Give the names and values of the figures whose bits are set."""
    names, pick = _picks(mask)
    values = pick(row)
    return names, (values if len(names) > 1 else (values,))


@cache
def _picks(mask: int) -> tuple[tuple[str, ...], Any]:
    places = [n for n in range(len(NUMBERS)) if mask >> n & 1]
    return tuple(_NAMES[n] for n in places), itemgetter(*places)


def _between(befores: list[Report], between: list[Between]) -> Figures:
    """Give the figures at the instant, as `at_instant` has them, rounded."""
    flat = list(chain.from_iterable(map(_figures, befores)))
    figures = np.array(flat, dtype=np.float64).reshape(-1, len(NUMBERS))
    if between:
        places = np.array([place for place, _, _ in between])[:, None]
        part = np.array([part for _, part, _ in between])[:, None]
        flat = list(chain.from_iterable([_moved(report) for _, _, report in between]))
        before = figures[places, _MOVED_COLUMNS]
        step = np.array(flat, dtype=np.float64).reshape(before.shape) - before
        step[:, -1] = _remainders(step[:, -1])
        now = before + part * step
        now[:, -1] = _remainders(now[:, -1])
        figures[places, _MOVED_COLUMNS] = now
    scaled = figures * _SCALES
    # adding 0.0 makes 0.0 of -0.0
    return np.where(np.abs(scaled) < EXACT_MAX, np.rint(scaled) / _SCALES + 0.0, figures)


def _remainders(angles_rad: npt.NDArray[np.float64]) -> list[float]:
    """`math.remainder` of each by a full turn: numpy has no such function."""
    remainder, turn = math.remainder, math.tau
    return [remainder(angle, turn) for angle in angles_rad.tolist()]
