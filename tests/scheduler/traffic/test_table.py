"""Design notes, traffic §8.11: the conflict table on generated maps."""

import math
from itertools import pairwise

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.ids import PointName
from ledger.scene import Area, Group, Path, Point
from scheduler.traffic.cells import Cells
from scheduler.traffic.compile import compile_area
from scheduler.traffic.geometry import placed, poses_along
from scheduler.traffic.roadmap import Roadmap
from tests.scheduler.traffic.maps import area_of

FINE = 24  # poses in a piece for the exact sweep
TOUCH_M2 = 1e-3
PAIRS = 400  # of random poses looked at on each map

offset = st.floats(-0.5, 0.5).map(lambda x: round(x, 2))


@st.composite
def areas(draw: st.DrawFn) -> Area:
    """Lanes between neighbours on a bent lattice, straight or curved, some driven in reverse."""
    pitch = draw(st.sampled_from([0.8, 1.5, 3.0]))
    points = [
        Point(
            name=PointName(f"P{i}-{j}"),
            x_m=pitch * i + pitch / 2 * draw(offset),
            y_m=pitch * j + pitch / 2 * draw(offset),
        )
        for i in range(3)
        for j in range(3)
    ]
    paths = []
    for a in points:
        for b in points:
            near = math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) < 1.6 * pitch
            if a.name < b.name and near and draw(st.integers(0, 2)):
                bend = [(draw(offset) * pitch, draw(offset) * pitch) for _ in range(2)]
                thirds = ((1 / 3, bend[0]), (2 / 3, bend[1]))
                controls = tuple(
                    (a.x_m + (b.x_m - a.x_m) * t + dx, a.y_m + (b.y_m - a.y_m) * t + dy)
                    for t, (dx, dy) in thirds
                )
                curve = controls if draw(st.booleans()) else ()
                back = draw(st.integers(0, 3)) == 0
                paths.append(Path(start=a.name, end=b.name, controls=curve, backward=back))
                if draw(st.booleans()):
                    paths.append(Path(start=b.name, end=a.name, controls=curve[::-1]))
    return area_of(points, paths)


@st.composite
def groups(draw: st.DrawFn) -> list[Group]:
    """One or two kinds of robots, with or without symmetry."""
    found = []
    for k in range(draw(st.integers(1, 2))):
        front, rear, half = (draw(st.sampled_from([0.3, 0.5, 0.8])) for _ in range(3))
        corners = ((front, half), (-rear, half), (-rear, -half), (front, -half))
        found.append(Group(id=k, name=f"g{k}", footprint=corners[: 4 - k]))
    return found


def rows(cells: Cells) -> list[set[int]]:
    bounds = pairwise(cells.indptr.tolist())
    return [set(cells.indices[a:b].tolist()) for a, b in bounds]


def swept(roadmap: Roadmap) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Per piece of a path: its cell, its footprint, and poses close to each other."""
    found = []
    for footprint, corners in enumerate(roadmap.footprints):
        for path, given_path in enumerate(roadmap.net.paths):
            cells = [cell for cell, _ in roadmap.path_cells(footprint, path)]
            curve = roadmap.net.traces.curves[path]
            _, poses = poses_along(curve, FINE * len(cells) + 1, given_path.backward)
            for k, cell in enumerate(cells):
                found.append((cell, corners, poses[k * FINE : (k + 1) * FINE + 1]))
    return found


@settings(max_examples=10, deadline=None)
@given(areas(), groups(), st.randoms(use_true_random=False))
def test_the_table_is_symmetric_and_holds_all_overlaps_of_poses(area, kinds, chance):
    roadmap = compile_area(area, kinds)
    table = rows(roadmap.cells)
    for cell, row in enumerate(table):
        assert cell not in row
        assert all(cell in table[other] for other in row)
    assert roadmap.cells.disagreed == 0
    pieces = swept(roadmap)
    for _ in range(PAIRS if pieces else 0):
        bodies = []
        for cell, corners, poses in (chance.choice(pieces), chance.choice(pieces)):
            pose = poses[chance.randrange(len(poses))]
            bodies.append((cell, shapely.Polygon(placed(corners, pose[None])[0])))
        (a, first), (b, second) = bodies
        if a != b and first.intersection(second).area > TOUCH_M2:
            assert b in table[a]


@settings(max_examples=10, deadline=None)
@given(areas(), groups())
def test_the_table_adds_few_pairs_beyond_the_exact_sweep(area, kinds):
    roadmap = compile_area(area, kinds)
    table = rows(roadmap.cells)
    exact: dict[int, shapely.Geometry] = {}
    for cell, corners, poses in swept(roadmap):
        if cell not in exact:
            bodies = placed(corners, poses)
            steps = np.concatenate((bodies[:-1], bodies[1:]), axis=1)
            exact[cell] = shapely.union_all(shapely.convex_hull(shapely.multipoints(steps)))
    numbers, shapes = list(exact), np.array(list(exact.values()), dtype=object)
    left, right = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    needed = sum(a < b for a, b in zip(left.tolist(), right.tolist(), strict=True))
    listed = sum(cell < other and other in exact for cell in numbers for other in table[cell])
    assert listed <= 1.1 * needed + 2
