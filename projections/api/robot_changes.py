"""What has changed of a scene's robots since the last look: only the fields that differ.

A thousand robots that all drive are looked at in 4 ms (bench/stream.py): the figures that change
with every report are interpolated and rounded as arrays, and each other part of a row is made anew
only where its inputs are others than last time. The rows are those of `ui_report`, to the digit.
"""

import math
from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from ledger.ids import OrderId, RobotKey, RobotName
from ledger.link import Plan, Report
from ledger.scene import Group, Scene
from ledger.state import Order, Robot
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
from projections.api.m4_seen import groups_of, instant_of
from projections.fields import Row
from projections.live import Live
from projections.poses import around, at_instant

Changes: TypeAlias = dict[str, Any]  # by robot: field -> value, None = gone; None = robot gone
Figures: TypeAlias = npt.NDArray[np.float64]  # (n_robots, n_columns)

_figures = attrgetter(*(field for _, field, _ in NUMBERS))
_MOVED = ("x_m", "y_m", "speed_mps", "turn_radps")  # interpolated as they are; the heading turns
_COLUMN = {field: n for n, (_, field, _) in enumerate(NUMBERS)}
_MOVED_COLUMNS = [_COLUMN[field] for field in _MOVED]
_HEADING = _COLUMN["heading_rad"]
_SCALES = np.array([scale for _, _, scale in NUMBERS])
_NAMES = tuple(name for name, _, _ in NUMBERS)
_BITS = np.array([1 << n for n in range(len(NUMBERS))])
_COLUMNS_OF = [
    [n for n in range(len(NUMBERS)) if bits >> n & 1] for bits in range(1 << len(NUMBERS))
]

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
        "plan",
        "report",
        "robot",
        "row",
        "said",
        "said_of",
        "shown_ms",
        "traffic",
    )

    def __init__(self) -> None:
        self.robot: Robot | None = None
        self.group: Group | None = None
        self.known: tuple[Order, ...] = ()
        self.plan: Plan | None = None
        self.report: Report | None = None
        self.said_of: tuple[Any, ...] | None = None
        self.shown_ms: int | None = None
        self.row: Row = {}
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
        self._reporting: list[Track] = []
        self._figures: Figures = np.empty((0, len(NUMBERS)))

    def rows(self) -> dict[RobotName, Row]:
        """Give all robots as they were shown last."""
        found = {}
        for track in self._tracks.values():
            assert track.robot is not None
            if track.shown_ms is not None:
                track.row["rTime"] = track.shown_ms
            found[track.robot.name] = track.row
        return found

    def shown(self) -> dict[RobotKey, Robot]:
        """Give the robots that clients see."""
        return {key: robot for key, robot in self._robots.items() if key in self._tracks}

    def look(self, live: Live, scene: Scene, robots: dict[RobotKey, Robot] | None) -> Changes:
        """Give what has changed. `robots` are those of the scene; None = as they were last time.

        `rTime` is named only for a robot whose own is not `instant_ms` as that of all who answer.
        """
        changes: Changes = {}
        if robots is not None:
            self._follow(live.fleet.orders, scene, robots, changes)
        self.instant_ms = instant_of(live, self._robots)
        self.plans_changed = robots is not None
        self._see(live, changes)
        return changes

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
            gone = self._tracks.pop(key).robot
            assert gone is not None
            changes[gone.name] = None
        groups = groups_of(scene)
        for key, robot in shown.items():
            track = self._tracks.get(key)
            if track is None:
                track = self._tracks[key] = Track()
            known = orders_of(robot, orders)
            same_orders = _same(known, track.known)
            if track.robot is robot and same_orders and not anew:
                continue
            track.robot, track.known, track.group = robot, known, groups[robot.config.group]
            change = _part(track, "identity", identity(robot, track.group))
            change |= self._report_parts(track)
            change |= self._plan_parts(track)
            if change:
                changes.setdefault(robot.name, {}).update(change)

    def _report_parts(self, track: Track) -> Row:
        assert track.robot is not None and track.group is not None
        return _part(track, "said", said(track.robot, track.group, track.report))

    def _plan_parts(self, track: Track) -> Row:
        robot, report, plan = track.robot, track.report, track.plan
        assert robot is not None
        change = _part(track, "errand", errand(robot, track.known, report, plan))
        return change | _part(track, "traffic", traffic(track.known, report, plan, self._points))

    def _see(self, live: Live, changes: Changes) -> None:
        """Take in what robots report and traffic intends."""
        reporting: list[Track] = []
        befores: list[Report] = []
        between: list[tuple[int, float, Report]] = []  # place in `befores`, part, report after
        for key, track in self._tracks.items():
            assert track.robot is not None
            report = live.reports.get(key)
            if report is not None:
                if track.robot.online and self.instant_ms is not None:
                    report = self._at_instant(live.recent[key], len(befores), between)
                reporting.append(track)
                befores.append(report)
            change = self._seen(track, report, live.plans.get(key))
            if change:
                changes.setdefault(track.robot.name, {}).update(change)
        self._changed_figures(reporting, _between(befores, between), changes)

    def _at_instant(
        self, recent: Sequence[Report], place: int, between: list[tuple[int, float, Report]]
    ) -> Report:
        """Give the report around which the instant lies, and note what is to be interpolated."""
        assert self.instant_ms is not None
        newest = recent[-1]
        if newest.at_ms == self.instant_ms:
            return newest
        before, after = around(recent, self.instant_ms)
        if before is None or after is None or before.area != after.area:
            return at_instant(recent, self.instant_ms)
        part = (self.instant_ms - before.at_ms) / (after.at_ms - before.at_ms)
        between.append((place, part, after))
        return before

    def _seen(self, track: Track, report: Report | None, plan: Plan | None) -> Row | None:
        """Make the parts anew whose inputs have changed; the figures come later."""
        said_of = None if report is None else _said(report)
        new_report = said_of != track.said_of
        new_plan = plan is not track.plan and not _alike(plan, track.plan)
        track.report, track.plan = report, plan
        change: Row | None = None
        if report is not None:
            assert track.robot is not None
            change = self._time(track, report, online=track.robot.online)
        if not (new_report or new_plan):
            return change
        track.said_of = said_of
        self.plans_changed |= new_plan
        change = change or {}
        if new_report:
            change |= self._report_parts(track)
        return change | self._plan_parts(track)

    def _time(self, track: Track, report: Report, *, online: bool) -> Row | None:
        """Say when the robot was so, where that is not the instant of all who answer."""
        shown_ms = report.at_ms
        if online and self.instant_ms is not None:
            shown_ms = _shown_ms(report, self.instant_ms)
            if shown_ms == self.instant_ms and track.shown_ms is not None:
                track.shown_ms = shown_ms
                return None
        elif shown_ms == track.shown_ms:
            return None
        track.shown_ms = shown_ms
        return {"rTime": shown_ms}

    def _changed_figures(self, reporting: list[Track], figures: Figures, changes: Changes) -> None:
        if reporting != self._reporting:
            self._reporting, self._figures = reporting, np.full(figures.shape, np.nan)
        bits = ((figures != self._figures) @ _BITS).tolist() if reporting else []
        self._figures = figures
        rows = figures.tolist()
        for place, mask in enumerate(bits):
            if mask:
                track, row = reporting[place], rows[place]
                change = {_NAMES[n]: row[n] for n in _COLUMNS_OF[mask]}
                track.row.update(change)
                assert track.robot is not None
                known = changes.get(track.robot.name)
                if known is None:
                    changes[track.robot.name] = change
                else:
                    known.update(change)


def _shown_ms(report: Report, instant_ms: int) -> int:
    """A report from before the instant was brought to it; a newer one is the first there is."""
    return max(report.at_ms, instant_ms)


def _same(one: tuple[Order, ...], other: tuple[Order, ...]) -> bool:
    """Whether these are the same values; comparing them field by field is not needed."""
    return len(one) == len(other) and all(map(_is, one, other))


def _is(one: Order, other: Order) -> bool:
    return one is other


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


def _between(befores: list[Report], between: list[tuple[int, float, Report]]) -> Figures:
    """Give the figures at the instant, as `at_instant` has them, rounded."""
    if not befores:
        return np.empty((0, len(NUMBERS)))
    figures = np.array([_figures(report) for report in befores], dtype=np.float64)
    if between:
        places = [place for place, _, _ in between]
        part = np.array([part for _, part, _ in between])
        after = np.array([_figures(report) for _, _, report in between], dtype=np.float64)
        before = figures[places]
        for column in _MOVED_COLUMNS:
            moved = before[:, column] + part * (after[:, column] - before[:, column])
            figures[places, column] = moved
        turn_rad = _remainder(after[:, _HEADING] - before[:, _HEADING])
        figures[places, _HEADING] = _remainder(before[:, _HEADING] + part * turn_rad)
    scaled = figures * _SCALES
    # adding 0.0 makes 0.0 of -0.0
    return np.where(np.abs(scaled) < EXACT_MAX, np.rint(scaled) / _SCALES + 0.0, figures)


def _remainder(angles_rad: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """`math.remainder` of each by a full turn: numpy has no such function."""
    remainder, turn = math.remainder, math.tau
    return np.array([remainder(angle, turn) for angle in angles_rad.tolist()])
