"""Traffic on real maps and on open grids: orders per hour beside free flow, as in `bench.floors`.

Run as `python -m bench.maps`, or with `--quick`. The two vendors' maps are read from beside this
repository and left out where they are missing; orders go to random points of them. On open grids
points lie closer than a footprint and every one has lanes to all four sides: where robots may stop
is the compiler's to choose (design notes, traffic §11, "not solved").
"""

from functools import partial

from bench.floors import GROUPS, Instance, Row, lattice, report, row
from ledger.ids import PointName
from ledger.scene import Area
from scheduler.traffic.compile import compile_area
from tests.scheduler.traffic.maps import SMAPS, smap

SIDE = 38  # points along each side of an open grid
# Map, robots, share of free flow at least: the prototype's.
REAL = (
    ("seer_sample_3", 4, 0.71),
    ("seer_sample_3", 8, 0.37),
    ("ws_ps_bins", 3, 0.81),
    ("ws_ps_bins", 6, 0.59),
)
OPEN = ((0.5, 30, 0.60), (0.7, 30, 0.72), (0.7, 60, 0.54), (1.0, 60, 0.41))  # spacing in metres


def _places(area: Area) -> list[PointName]:
    """Points where an order may end."""
    return list(compile_area(area, GROUPS).place)


def _stops(area: Area) -> list[PointName]:
    roadmap = compile_area(area, GROUPS)
    return [name for name, place in roadmap.place.items() if place < roadmap.places.stops]


def instances() -> list[Instance]:
    """Real maps where their files are, and open grids."""
    real = [
        Instance(
            name=name,
            robots=robots,
            area=partial(smap, name),
            starts=_stops,
            goals=_places,
            service_s=5.0,
            share=share,
            quick_s=1200,
        )
        for name, robots, share in REAL
        if (SMAPS / f"{name}.smap").exists()
    ]
    return real + [
        Instance(
            name=f"open grid {spacing_m} m",
            robots=robots,
            area=partial(lattice, SIDE, spacing_m, spacing_m),
            starts=_stops,
            goals=_stops,
            share=share,
            hours=0.25,
            quick_s=240,
        )
        for spacing_m, robots, share in OPEN
    ]


def rows(quick: bool = False, only: str = "") -> list[Row]:
    """Every instance, or those whose name has `only` in it."""
    return [row(i, quick) for i in instances() if only in f"{i.name} {i.robots}"]


if __name__ == "__main__":
    report("traffic: real maps and open grids", rows, __doc__)
