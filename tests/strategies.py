"""Hypothesis strategies that several test packages share: values of any type, and scenes."""

import types
from enum import Enum
from typing import Any, NewType, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
from hypothesis import strategies as st

from ledger.events import EVENTS, AnyEvent, Event
from ledger.ids import BinName, PointName, RobotName, SceneId
from ledger.scene import (
    Area,
    Bin,
    BinTask,
    Group,
    Path,
    Point,
    PointKind,
    RobotConfig,
    SceneFile,
)

SCENE = SceneId("5f0c1e9a2b3c4d5e6f708192")
DAY_MS = 1_790_000_000_000  # some time in 2026, where histories begin

T = TypeVar("T")
_INTEGERS = st.integers(-(2**53), 2**53)
_FLOATS = st.floats(allow_nan=False, allow_infinity=False, width=64)


def values(of: type[T]) -> st.SearchStrategy[T]:
    """Any value of a msgspec struct, every field drawn by its type, defaults or not."""
    return st.deferred(lambda: _values(of))


def _values(of: Any) -> st.SearchStrategy[Any]:
    origin, args = get_origin(of), get_args(of)
    if isinstance(of, NewType):
        return _values(of.__supertype__)
    if of is type(None):
        return st.none()
    if of is bool:
        return st.booleans()
    if of is int:
        return _INTEGERS
    if of is float:
        return _FLOATS
    if of is str:
        return st.text(max_size=8)
    if origin in (Union, types.UnionType):
        return st.one_of([_values(arg) for arg in args])
    if origin is tuple and args[-1] is Ellipsis:
        return st.lists(values(args[0]), max_size=3).map(tuple)
    if origin is tuple:
        return st.tuples(*map(_values, args))
    if origin is dict:
        return st.dictionaries(_values(args[0]), values(args[1]), max_size=3)
    if isinstance(of, type) and issubclass(of, Enum):
        return st.sampled_from(of)
    assert isinstance(of, type) and issubclass(of, msgspec.Struct), of
    hints = get_type_hints(of)
    fields = {name: values(hints[name]) for name in of.__struct_fields__}
    return st.builds(of, **fields)


def any_events() -> st.SearchStrategy[AnyEvent]:
    """One event of any type with any content; it need not make sense after any other."""
    return st.sampled_from(sorted(EVENTS, key=lambda t: t.__name__)).flatmap(values)  # type: ignore[arg-type]


def events_of(kind: type[Event]) -> st.SearchStrategy[Event]:
    """One event of this type with any content."""
    return values(kind)


def grid(columns: int = 4, rows: int = 3, robots: int = 2, pitch_m: float = 3.0) -> SceneFile:
    """A grid of two-way straight paths; bins on the bottom row, chargers and parking on the top."""

    def name(column: int, row: int) -> PointName:
        prefix = "AP" if row == 0 else "CP" if row == rows - 1 and column == 0 else "LM"
        return PointName(f"{prefix}{row * columns + column + 1}")

    def kind(column: int, row: int) -> PointKind:
        if row == 0:
            return PointKind.ACTION
        if row < rows - 1:
            return PointKind.WAYPOINT
        return PointKind.CHARGING if column == 0 else PointKind.PARKING

    cells = [(c, r) for r in range(rows) for c in range(columns)]
    points = tuple(
        Point(name=name(c, r), x_m=c * pitch_m, y_m=r * pitch_m, kind=kind(c, r)) for c, r in cells
    )
    lanes = [((c, r), (c + 1, r)) for c, r in cells if c + 1 < columns]
    lanes += [((c, r), (c, r + 1)) for c, r in cells if r + 1 < rows]
    paths = tuple(
        Path(start=name(*a), end=name(*b)) for lane in lanes for a, b in (lane, lane[::-1])
    )
    tasks = (BinTask(name="load", operation="JackLoad"), BinTask(name="unload", operation="Unload"))
    bins = tuple(
        Bin(name=BinName(f"B{c + 1}"), point=name(c, 0), tasks=tasks) for c in range(columns)
    )
    area = Area(
        id=0,
        name="hall",
        map_name="hall",
        map_digest="0" * 32,
        points=points,
        paths=paths,
        bins=bins,
    )
    return SceneFile(
        name="grid",
        areas=(area,),
        groups=(Group(id=0, name="small"),),
        robots=tuple(robot_config(n) for n in range(robots)),
    )


def robot_config(number: int, bins: int = 1) -> RobotConfig:
    """A simulated robot, numbered from 0."""
    return RobotConfig(name=RobotName(f"R{number + 1}"), simulated=True, bin_count=bins)


def scene_files() -> st.SearchStrategy[SceneFile]:
    """Small connected scenes with bins, a charger and robots."""
    return st.builds(grid, st.integers(2, 5), st.integers(2, 5), st.integers(1, 4))


def robot_configs() -> st.SearchStrategy[RobotConfig]:
    """Robots as scenes hold them."""
    return st.builds(robot_config, st.integers(0, 99), st.integers(1, 3))
