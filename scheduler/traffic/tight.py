"""Where a map has too little room for the bodies of its robots, in words."""

import math

import numpy as np
import numpy.typing as npt
import shapely
from scipy.sparse import csr_matrix

from ledger.scene import Area
from scheduler.traffic.finding import Finding, some
from scheduler.traffic.geometry import MARGIN_M
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.stops import clashes

# A move that meets more than this many others which it shares no stop with is one too near to other
# roads; on lanes of 2 m there are none (footprint of 1.1 x 0.8 m).
STRANGERS_MAX = 8
SHARE_MIN = 0.1  # of all moves: less is not worth a word


def findings(area: Area, roadmap: Roadmap) -> list[Finding]:
    """Points, turns and roads that are too near to each other, with and without loads."""
    return [
        *_points(area, roadmap),
        *_loads(area, roadmap),
        *_turns(area, roadmap),
        *_walls(area, roadmap),
        *_roads(area, roadmap),
    ]


def _points(area: Area, roadmap: Roadmap) -> list[Finding]:
    """Points so near to each other that two robots cannot rest on both."""
    net, pairs = roadmap.net, []
    for a, others in enumerate(clashes(net, roadmap.cells, len(roadmap.footprints) - 1)):
        for b in others:
            p, q = net.points[a], net.points[b]
            if a < b < net.named:  # those inside paths are ours
                pairs.append((math.hypot(p.x_m - q.x_m, p.y_m - q.y_m), p.name, q.name))
    if not pairs:
        return []
    named = [f"{a} and {b} ({way:.2f} m)" for way, a, b in sorted(pairs)]
    resting = sum(point < net.named for point in roadmap.places.point[: roadmap.places.stops])
    words = (
        f"Area {area.name}: {len(pairs)} pairs of points are so near to each other that robots "
        f"cannot rest and turn on both ({MARGIN_M:.2f} m of clearance included): {some(named)}. "
        f"Robots rest on {resting} of {net.named} points."
    )
    return [Finding(code="PointsTooNear", words=words)]


def _loads(area: Area, roadmap: Roadmap) -> list[Finding]:
    """Points where loads are taken beside which a robot rests well, until it has its load."""
    net, found = roadmap.net, []
    for group in roadmap.groups.values():
        empty = roadmap.classes.of(group.id)
        loaded = roadmap.classes.of(group.id, loaded=True)
        if empty == loaded:
            continue
        before, after = (clashes(net, roadmap.cells, kind) for kind in (empty, loaded))
        tight = {k: after[k] - before[k] for k in net.goals if after[k] - before[k]}
        if tight:
            named = [
                f"{net.points[k].name} ({some(sorted(net.points[q].name for q in others))})"
                for k, others in tight.items()
            ]
            words = (
                f"Area {area.name}: where loaded robots of group {group.name} hinder others at "
                f"points beside which empty ones do not: {some(sorted(named))}."
            )
            found.append(Finding(code="TightWhenLoaded", words=words))
    return found


def _turns(area: Area, roadmap: Roadmap) -> list[Finding]:
    """Points where a turn in place hits robots that rest elsewhere."""
    net, places = roadmap.net, roadmap.places
    stops = (1 << places.stops) - 1
    named = [
        net.points[point].name
        for place, point in enumerate(places.point)
        if net.points[point].turning and places.turning[place] & stops
    ]
    if not named:
        return []
    words = (
        f"Area {area.name}: robots that turn in place at these points hit others that rest nearby, "
        f"and wait for them to leave first: {some(sorted(named))}."
    )
    return [Finding(code="TurnHitsRobots", words=words)]


def _walls(area: Area, roadmap: Roadmap) -> list[Finding]:
    """Points where a turn in place would hit a wall of the drawing."""
    net, widest = roadmap.net, len(roadmap.footprints) - 1
    used = [k for k in range(net.named) if net.points[k].turning and net.neighbours[k]]
    if not area.walls or not used:
        return []
    discs = [roadmap.polygon(roadmap.disc(widest, point)) for point in used]
    tree = shapely.STRtree(shapely.linestrings(np.array(area.walls)))
    hit = sorted({net.points[used[k]].name for k in tree.query(discs, predicate="intersects")[0]})
    if not hit:
        return []
    words = (
        f"Area {area.name}: a turn in place at these points would hit a wall ({MARGIN_M:.2f} m of "
        f"clearance included); forbid turning there if robots must: {some(hit)}."
    )
    return [Finding(code="TurnHitsWall", words=words)]


def _roads(area: Area, roadmap: Roadmap) -> list[Finding]:
    """Roads beside each other that cannot be driven at the same time."""
    strangers, count = _strangers(roadmap), roadmap.moves.count
    near = [(int(-n), move) for move, n in enumerate(strangers.tolist()) if n > STRANGERS_MAX]
    if len(near) < max(1, SHARE_MIN * count):
        return []
    net, names = roadmap.net, list[str]()
    for minus, move in sorted(near):
        key = net.paths[roadmap.moves.paths[move][0]].key
        if not any(key in name for name in names):
            names.append(f"{key} ({-minus})")
    words = (
        f"Area {area.name}: {len(near) / count:.0%} of the ways between stops cannot be driven "
        f"while robots are on more than {STRANGERS_MAX} others that lead elsewhere, for roads lie "
        f"nearer to each other than a robot is wide: {some(names)}."
    )
    return [Finding(code="RoadsTooNear", words=words)]


def _strangers(roadmap: Roadmap) -> npt.NDArray[np.int64]:
    """Per move: others whose ground it meets, but for those that share a stop with it."""
    moves, cells, widest = roadmap.moves, roadmap.cells, len(roadmap.footprints) - 1
    rows, columns = [], []
    for move, paths in enumerate(moves.paths):
        ground = {cell for path in paths for cell, _ in roadmap.path_cells(widest, path)}
        rows += [move] * len(ground)
        columns += sorted(ground)
    shape = (moves.count, cells.count)
    over = csr_matrix((np.ones(len(rows), dtype=bool), (rows, columns)), shape=shape)
    ones = np.ones(len(cells.indices), dtype=bool)
    table = csr_matrix((ones, cells.indices, cells.indptr), shape=(cells.count, cells.count))
    a, b = csr_matrix(over @ table @ over.T).nonzero()
    start, end = np.array(moves.start), np.array(moves.end)
    apart = (start[a] != start[b]) & (start[a] != end[b])
    apart &= (end[a] != start[b]) & (end[a] != end[b])
    found: npt.NDArray[np.int64] = np.bincount(a[apart], minlength=moves.count)
    return found
