"""What a planner would trip over in a scene, in words, before any robot is on the floor."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable

import shapely

from ledger.ids import PointName
from ledger.scene import Area, PointKind, SceneFile
from scheduler.traffic import tight
from scheduler.traffic.compile import compile_area
from scheduler.traffic.costs import INFINITE, Costs
from scheduler.traffic.finding import Finding, some
from scheduler.traffic.network import Network, network
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.stops import passable

DEEP_M = 3.0  # a shorter dead end is a parking stub


def check_scene(scene: SceneFile) -> list[Finding]:
    """All findings, the unusable first."""
    found = _groups(scene)
    if not any(finding.unusable for finding in found):
        for area in scene.areas:
            if not area.disabled:
                found += _area(scene, area)
    return sorted(found, key=lambda finding: not finding.unusable)


def _groups(scene: SceneFile) -> list[Finding]:
    found = []
    if not scene.areas:
        found.append(Finding(code="NoArea", words="The scene has no area.", unusable=True))
    if not scene.groups:
        found.append(Finding(code="NoGroup", words="The scene has no robot group.", unusable=True))
    for group in scene.groups:
        for corners in (group.footprint, group.footprint_loaded):
            if corners is None or (len(corners) > 2 and shapely.Polygon(corners).area >= 1e-4):
                continue
            words = f"Group {group.name} has no footprint: at least three corners are needed."
            found.append(Finding(code="FootprintEmpty", words=words, unusable=True))
        limits = group.kinematics
        if min(limits.speed_mps_max, limits.acceleration_mps2_max) <= 0 or (
            min(limits.turn_radps_max, limits.turn_radps2_max) <= 0
        ):
            words = f"Group {group.name} cannot move: every limit of its kinematics must be > 0."
            found.append(Finding(code="KinematicsZero", words=words, unusable=True))
    known = {group.id for group in scene.groups}
    for robot in scene.robots:
        if robot.group not in known:
            words = f"Robot {robot.name} is of group {robot.group}, which is not there."
            found.append(Finding(code="GroupUnknown", words=words, unusable=True))
    return found


def _area(scene: SceneFile, area: Area) -> list[Finding]:
    found = _names(area)
    if any(finding.unusable for finding in found):
        return found
    roadmap = compile_area(area, scene.groups)
    costs = Costs(roadmap, scene.groups[0].kinematics)
    if not roadmap.places.stops:
        words = f"Area {area.name} has no place where a robot may rest."
        return [*found, Finding(code="NoStop", words=words, unusable=True)]
    found += tight.findings(area, roadmap)
    if not roadmap.moves.count:
        words = f"Area {area.name}: no robot can go from one place to another."
        return [*found, Finding(code="NoMove", words=words, unusable=True)]
    found += _room(area, roadmap, len(scene.robots) if len(scene.areas) == 1 else 0)
    found += _reach(area, roadmap, costs)
    found += _turning(area, roadmap.net)
    found += _pockets(area, roadmap)
    found += _blocking(area, roadmap)
    return found


def _names(area: Area) -> list[Finding]:
    """Names that mean nothing or two things; what no path can be made of."""
    found: list[Finding] = []

    def say(code: str, names: Iterable[str], words: str, unusable: bool) -> None:
        listed = sorted(names)
        if listed:
            text = f"Area {area.name}: {words}: {some(listed)}."
            found.append(Finding(code=code, words=text, unusable=unusable))

    points = Counter(point.name for point in area.points)
    keys = Counter(path.key for path in area.paths)
    at = {point.name: point for point in area.points}
    say("PointTwice", (n for n, k in points.items() if k > 1), "points of the same name", True)
    odd = (p.name for p in area.points if not (math.isfinite(p.x_m) and math.isfinite(p.y_m)))
    say("PointNowhere", odd, "points without a position", True)
    say("PathTwice", (n for n, k in keys.items() if k > 1), "paths with the same ends", True)
    loose = {path.key for path in area.paths if path.start not in at or path.end not in at}
    say("PathEndUnknown", loose, "paths whose ends are not points of the area", True)
    net = network(area)
    empty = keys.keys() - loose - {path.key for path in net.paths}
    say("PathEmpty", empty, "paths without length, which are left out", False)
    slow = (p.key for p in area.paths if p.speed_mps_max is not None and p.speed_mps_max <= 0)
    say("PathSpeedZero", slow, "paths with no speed", True)
    lost = (bin.name for bin in area.bins if bin.point not in at)
    say("BinPointUnknown", lost, "bins at points that are not there", True)
    alone = (net.points[k].name for k, near in enumerate(net.neighbours) if not near)
    say("PointAlone", alone, "points that no path touches", False)
    return found


def _room(area: Area, roadmap: Roadmap, robots: int) -> list[Finding]:
    """Robots need free stops to move at all, and many of them to move well (measured: 0.8 of free
    flow with 10 % of the stops taken, 0.5 with 27 %).
    """
    stops = roadmap.places.stops
    if robots > 1 and robots >= stops:
        words = f"Area {area.name} has {stops} stops: {robots} robots have no room to move."
        return [Finding(code="TooManyRobots", words=words, unusable=True)]
    if robots > max(1, stops / 4):
        words = (
            f"Area {area.name}: {robots} robots on {stops} stops will mostly wait for each other."
        )
        return [Finding(code="Crowded", words=words)]
    return []


def _reach(area: Area, roadmap: Roadmap, costs: Costs) -> list[Finding]:
    """Places that cannot be reached from most others, or not left again."""
    net, place = roadmap.net, roadmap.place
    hub = _hub(roadmap, costs)
    named = {bin.point: bin.name for bin in area.bins}
    deaf, blind, loose_bins = [], [], []
    for k, point in enumerate(net.points):
        if not net.neighbours[k]:
            continue
        name = f"{point.name} (bin {named[point.name]})" if point.name in named else point.name
        here = place.get(point.name)
        if here is None:
            if point.name in named:
                loose_bins.append(name)
            continue
        if here != hub and _from(roadmap, costs, hub, here) == INFINITE:
            deaf.append(name)
        elif here != hub and _from(roadmap, costs, here, hub) == INFINITE:
            blind.append(name)
    found = []
    for code, names, words in (
        ("Unreachable", deaf, "points that robots cannot get to from the rest of the area"),
        ("DeadEnd", blind, "points that robots get into and not out of again"),
        ("BinUnreachable", loose_bins, "bins at points where no robot may stop"),
    ):
        if names:
            text = f"Area {area.name}: {words}: {some(sorted(names))}."
            found.append(Finding(code=code, words=text))
    return found


def _hub(roadmap: Roadmap, costs: Costs) -> int:
    """A stop of the part of the map in which most stops lead to each other."""
    best = [0] * roadmap.places.stops
    for move, end in enumerate(roadmap.moves.end):
        if end < roadmap.places.stops and not costs.outside[move]:
            best[end] += 1
    return max(range(len(best)), key=lambda k: (best[k], -k))


def _from(roadmap: Roadmap, costs: Costs, start: int, end: int) -> float:
    """The cheapest way, whatever the heading at its start."""
    return min(
        (
            costs.onward_s(start, roadmap.heading_start[move], move, end)
            for move in roadmap.leaving[start]
        ),
        default=INFINITE,
    )


def _turning(area: Area, net: Network) -> list[Finding]:
    stuck = [p.name for k, p in enumerate(net.points) if net.neighbours[k] and not passable(net, k)]
    if not stuck:
        return []
    words = (
        f"Area {area.name}: points where turning is forbidden and no path goes on with the heading "
        f"of arrival: {some(sorted(stuck))}."
    )
    return [Finding(code="TurnNeeded", words=words)]


def _pockets(area: Area, roadmap: Roadmap) -> list[Finding]:
    """Dead ends with room for several robots, which cannot pass each other there."""
    inside: dict[int, list[int]] = {}
    for place, pocket in enumerate(roadmap.pockets.pocket):
        if pocket >= 0:
            inside.setdefault(pocket, []).append(place)
    depth = roadmap.pockets.depth_m
    ends = []
    for places in inside.values():
        deepest = max(places, key=lambda place: (depth[place], -place))
        if len(places) > 1 and depth[deepest] >= DEEP_M:
            ends.append((-depth[deepest], _name(roadmap, deepest)))
    if not ends:
        return []
    named = [f"{name} ({-way:.0f} m)" for way, name in sorted(ends)]
    words = (
        f"Area {area.name}: {len(ends)} dead ends, where robots cannot pass each other: one enters "
        f"only behind those who go deeper, and waits for all who come out: {some(named)}."
    )
    return [Finding(code="NoWayThrough", words=words)]


def _blocking(area: Area, roadmap: Roadmap) -> list[Finding]:
    """Places where a robot that stays stands in the way of others."""
    net, places = roadmap.net, roadmap.places
    stay: dict[int, str] = {}
    for place, point in enumerate(places.point):
        if net.points[point].kind in (PointKind.PARKING, PointKind.CHARGING):
            stay[place] = "StopBlocksLane"
        elif point in net.goals:
            stay[place] = "WorkBlocksLane"
    blocked: dict[str, Counter[PointName]] = defaultdict(Counter)
    bits = sum(1 << place for place in stay)
    for move, need in enumerate(roadmap.moves.need):
        met = need & bits & ~(1 << roadmap.moves.end[move])
        while met:
            low = met & -met
            place = low.bit_length() - 1
            blocked[stay[place]][net.points[places.point[place]].name] += 1
            met ^= low
    found = []
    for code, who in (
        ("StopBlocksLane", "rests on these parking places or chargers"),
        ("WorkBlocksLane", "works at these points"),
    ):
        if blocked[code]:
            named = [f"{name} ({count} ways)" for name, count in blocked[code].most_common()]
            words = (
                f"Area {area.name}: a robot that {who} blocks ways between other points: "
                f"{some(named)}."
            )
            found.append(Finding(code=code, words=words))
    return found


def _name(roadmap: Roadmap, place: int) -> str:
    return roadmap.net.points[roadmap.places.point[place]].name
