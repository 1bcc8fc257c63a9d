"""MovingAI grid maps (`type octile`): every passable cell a point, lanes to its four neighbours.

`.`, `G` and the task cells `E` and `S` (League of Robot Runners) are passable; at task cells work
is done. Points are named by row and column, counted from 0 at the top left as in the file.
"""

import hashlib
from collections import deque

from commands.imports.checks import BAD_SCENE, checked, simulated
from ledger.errors import Refused
from ledger.ids import PointName
from ledger.scene import Area, Group, Path, Point, PointKind, SceneFile

PITCH_M = 1.5  # robots of 1.0 x 0.7 m can stand and turn on neighbouring cells
PASSABLE = frozenset(".GES")
WORK = frozenset("ES")
CELLS_MAX = 1_000_000
SPARE_PARKING = 2

Cell = tuple[int, int]  # row, column


def read_movingai(
    raw: bytes,
    *,
    name: str | None,
    robots: int,
    pitch_m: float = PITCH_M,
    groups: tuple[Group, ...] | None = None,
) -> SceneFile:
    """Read a grid, the top row at the greatest y. Raises Refused, naming the line.

    Parking is spread over the largest connected part, on cells with a way round them.
    """
    if not pitch_m > 0.0:
        raise Refused(BAD_SCENE, f"pitch_m must be above 0, not {pitch_m}", pitch_m)
    rows = _rows(raw)
    cells = {
        (row, column)
        for row, line in enumerate(rows)
        for column, letter in enumerate(line)
        if letter in PASSABLE
    }
    if not cells:
        raise Refused(BAD_SCENE, "the map has no passable cell")
    parking = _parking(rows, cells, robots + SPARE_PARKING)
    names = {cell: PointName(f"C{cell[0]}-{cell[1]}") for cell in sorted(cells)}
    points = tuple(
        Point(
            name=names[cell],
            x_m=round(cell[1] * pitch_m, 3),
            y_m=round((len(rows) - 1 - cell[0]) * pitch_m, 3),
            kind=_kind(rows, cell, parking),
        )
        for cell in names
    )
    paths = tuple(
        Path(start=names[cell], end=names[other])
        for cell in names
        for other in _neighbours(cell)
        if other in cells
    )
    kinds = groups or (Group(id=0, name="default"),)
    given = name or "grid"
    area = Area(
        id=0,
        name=given,
        map_name=given,
        map_digest=hashlib.md5(raw, usedforsecurity=False).hexdigest(),
        points=points,
        paths=paths,
    )
    return checked(
        SceneFile(name=given, areas=(area,), groups=kinds, robots=simulated(robots, kinds))
    )


def _rows(raw: bytes) -> list[str]:
    try:
        lines = raw.decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise Refused(BAD_SCENE, f"a grid map is ASCII text: {error}") from error
    sizes: dict[str, int] = {}
    at = 0
    while at < len(lines) and lines[at].strip() != "map":
        key, _, value = lines[at].strip().partition(" ")
        at += 1
        if key == "type" or not key:
            continue
        if key not in ("height", "width") or not value.strip().isdigit():
            raise Refused(BAD_SCENE, f"line {at}: not a head line of a grid map: {key!r}", at)
        sizes[key] = int(value)
    if at == len(lines):
        raise Refused(BAD_SCENE, "the line 'map' is missing")
    for key in ("height", "width"):
        if key not in sizes:
            raise Refused(BAD_SCENE, f"the line '{key}' is missing", key)
    height, width = sizes["height"], sizes["width"]
    if height * width > CELLS_MAX:
        raise Refused(BAD_SCENE, f"a grid has at most {CELLS_MAX} cells, not {height * width}")
    rows = lines[at + 1 : at + 1 + height]
    if len(rows) < height:
        raise Refused(BAD_SCENE, f"height is {height}, but there are {len(rows)} rows", "height")
    for i, row in enumerate(rows):
        if len(row) != width:
            line = at + 2 + i
            raise Refused(BAD_SCENE, f"line {line}: {len(row)} cells, width is {width}", line)
    return rows


def _neighbours(cell: Cell) -> tuple[Cell, Cell, Cell, Cell]:
    row, column = cell
    return ((row - 1, column), (row, column - 1), (row, column + 1), (row + 1, column))


def _kind(rows: list[str], cell: Cell, parking: set[Cell]) -> PointKind:
    if cell in parking:
        return PointKind.PARKING
    return PointKind.ACTION if rows[cell[0]][cell[1]] in WORK else PointKind.WAYPOINT


def _parking(rows: list[str], cells: set[Cell], wanted: int) -> set[Cell]:
    """Choose cells that are no task cells, evenly through the map, and block nobody's only way."""
    largest = _largest_part(cells)
    free = [
        cell
        for cell in sorted(largest)
        if rows[cell[0]][cell[1]] not in WORK
        and sum(other in largest for other in _neighbours(cell)) >= 3
    ]
    if not free:
        return set()
    stride = max(1, len(free) // max(1, wanted))
    return set(free[stride // 2 :: stride][:wanted])


def _largest_part(cells: set[Cell]) -> set[Cell]:
    left = set(cells)
    largest: set[Cell] = set()
    while len(left) > len(largest):
        start = min(left)
        left.discard(start)
        part, queue = {start}, deque([start])
        while queue:
            for other in _neighbours(queue.popleft()):
                if other in left:
                    left.discard(other)
                    part.add(other)
                    queue.append(other)
        largest = max(largest, part, key=len)
    return largest
