import math
import random

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ledger.ids import PointName
from ledger.scene import Area, Group, Path, Point
from scheduler.traffic.compile import compile_area
from scheduler.traffic.geometry import placed, poses_along
from scheduler.traffic.overlap import overlaps, prism
from tests.scheduler.traffic.maps import area_of, lattice, warehouse

GROUP = Group(id=0, name="g")
ROUND = Group(
    id=1, name="r", footprint=tuple((0.3 * math.cos(a), 0.3 * math.sin(a)) for a in range(6))
)


def curvy() -> Area:
    names = [PointName(f"P{k}") for k in range(6)]
    chance = random.Random(3)
    points = [
        Point(name=name, x_m=chance.uniform(0, 6), y_m=chance.uniform(0, 6)) for name in names
    ]
    paths = [
        Path(
            start=a,
            end=b,
            controls=tuple((chance.uniform(0, 6), chance.uniform(0, 6)) for _ in range(2)),
            backward=chance.random() < 0.3,
        )
        for a in names
        for b in names
        if a < b
    ]
    return area_of(points, paths)


@pytest.mark.parametrize("area", [lattice(4, 4), warehouse(3, 6, 2), curvy()])
def test_the_conflict_table_is_symmetric_and_holds_every_overlap(area):
    cells = compile_area(area, [GROUP, ROUND]).cells
    rows = [
        set(cells.indices[cells.indptr[c] : cells.indptr[c + 1]].tolist())
        for c in range(cells.count)
    ]
    polygons = cells.polygons()
    for cell, row in enumerate(rows):
        assert cell not in row
        assert all(cell in rows[other] for other in row)
    left, right = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    for a, b in zip(left.tolist(), right.tolist(), strict=True):
        if a != b and polygons[a].intersection(polygons[b]).area > 1e-4:
            assert b in rows[a]
    assert cells.disagreed == 0


def test_sampled_poses_that_overlap_are_in_cells_that_conflict():
    area = curvy()
    roadmap = compile_area(area, [GROUP])
    chance = random.Random(5)
    footprint = np.array(GROUP.footprint)
    poses = []
    for path, given_path in enumerate(roadmap.net.paths):
        curve = roadmap.net.traces.curves[path]
        length, along = poses_along(curve, 200, given_path.backward)
        cells = roadmap.path_cells(0, path)
        for k in range(200):
            at = length * k / 199
            cell = next(c for c, end in cells if at <= end + 1e-9)
            poses.append((cell, shapely.Polygon(placed(footprint, along[k : k + 1])[0])))
    for _ in range(20_000):
        (a, first), (b, second) = chance.choice(poses), chance.choice(poses)
        if first.intersects(second):
            assert b in roadmap.conflicts(a)


def test_both_ways_of_a_straight_lane_share_their_cells():
    roadmap = compile_area(lattice(2, 1), [GROUP])
    there, back = ([cell for cell, _ in roadmap.path_cells(0, path)] for path in (0, 1))
    assert there == back[::-1]


@given(
    st.lists(
        st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(-3, 3)),
        min_size=2,
        max_size=2,
    )
)
def test_fcl_and_shapely_agree_on_boxes_that_do_not_merely_touch(poses):
    first, second = placed(np.array(GROUP.footprint), np.array(poses))
    a, b = shapely.Polygon(first), shapely.Polygon(second)
    if a.distance(b) > 1e-6 or a.intersection(b).area > 1e-6:
        assert overlaps(prism(first), prism(second)) == a.intersects(b)
