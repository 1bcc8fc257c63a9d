"""Grids of the planning literature, generated: cells, the ways between them, and where tasks are.

Only the shape is theirs. Sorting centre and fulfilment floor are those of RHCR (Li et al., AAAI-21,
figure 5), the warehouse that of the MovingAI benchmark; the random grid has the size and the share
of obstacles of random-32-32-20.
"""

import random
from pathlib import Path as FilePath
from typing import TypeAlias

import msgspec

XY: TypeAlias = tuple[int, int]  # column, row

EAST, NORTH, WEST, SOUTH = (1, 0), (0, 1), (-1, 0), (0, -1)
AROUND = (EAST, NORTH, WEST, SOUTH)
# In the rows of the stations, by column modulo 6; in the lowest row, and in the highest.
DETOURS = ({0: (-1,), 1: (1,), 2: (1,), 5: (-1,)}, {2: (-1,), 3: (-1,), 4: (1,), 5: (1,)})
# Not ours to hand on: used where it is beside this repository.
MOVING_AI = FilePath(__file__).parents[1] / "../shared/data/movingai"


class Floor(msgspec.Struct, frozen=True, kw_only=True):
    """A grid as tasks see it; `ways` are its one-step moves."""

    cells: tuple[XY, ...]
    ways: tuple[tuple[XY, XY], ...]
    goals: tuple[tuple[XY, ...], ...]  # a robot's goals alternate between these kinds
    homes: tuple[XY, ...]  # where robots begin
    nearest: bool = False  # of the first kind a robot goes to the nearest that has little to do


def _both_ways(cells: set[XY]) -> tuple[tuple[XY, XY], ...]:
    pairs = (((x, y), (x + dx, y + dy)) for x, y in sorted(cells) for dx, dy in AROUND)
    return tuple(pair for pair in pairs if pair[1] in cells)


def _open(cells: set[XY]) -> Floor:
    every = tuple(sorted(cells))
    return Floor(cells=every, ways=_both_ways(cells), goals=(every,), homes=every)


def sorting() -> Floor:
    """77 x 37: chutes in every third column and row, 25 stations on each long side, and one-way
    lanes in pairs that alternate in direction.
    """
    width, height = 77, 37
    chutes = {(x, y) for x in range(2, width, 3) for y in range(3, height - 1, 3)}
    corners = {(x, y) for x in (0, width - 1) for y in (0, height - 1)}
    cells = {(x, y) for x in range(width) for y in range(height)} - chutes - corners
    stations = {(x, y) for x in range(2, width, 3) for y in (0, height - 1)}
    ways = []
    for x, y in sorted(cells):
        ahead: list[XY] = []
        if x % 3 != 2:
            ahead.append(SOUTH if x % 6 < 2 else NORTH)
        if y in (0, height - 1):  # from the lanes that end here over a station to those that begin
            ahead += [(dx, 0) for dx in DETOURS[y > 0].get(x % 6, ())]
        elif y % 3:
            ahead.append(EAST if y % 6 < 3 else WEST)
        for dx, dy in ahead:
            if (x + dx, y + dy) in cells:
                ways.append(((x, y), (x + dx, y + dy)))
    drops = {(x + dx, y + dy) for x, y in chutes for dx, dy in AROUND if (x + dx, y + dy) in cells}
    return Floor(
        cells=tuple(sorted(cells)),
        ways=tuple(ways),
        goals=(tuple(sorted(stations)), tuple(sorted(drops))),
        homes=tuple(sorted(cells - stations - drops)),
        nearest=True,
    )


def fulfilment() -> Floor:
    """46 x 33: eight rows of three shelves of ten, goals along both long sides of each."""
    width, height = 46, 33
    spans = [range(7, 17), range(18, 28), range(29, 39)]
    columns = {x for span in spans for x in span}
    shelves = {(x, y) for x in columns for y in range(2, height, 4)}
    cells = {(x, y) for x in range(width) for y in range(height)} - shelves
    beside = tuple((x, y) for x in sorted(columns) for y in range(height) if y % 4 in (1, 3))
    homes = tuple((x, y) for x in (1, 2, 4, 5, 40, 41, 43, 44) for y in range(height) if y % 4)
    return Floor(cells=tuple(sorted(cells)), ways=_both_ways(cells), goals=(beside,), homes=homes)


def warehouse(columns: int = 10, rows: int = 20, margin: int = 25) -> Floor:
    """159 x 61 within the walls: shelves of 10 x 2 with lanes of one cell, goals anywhere."""
    width, height = 11 * columns - 1 + 2 * margin, 3 * rows + 1
    cells = {
        (x, y)
        for x in range(width)
        for y in range(height)
        if not (margin <= x < width - margin and (x - margin) % 11 < 10 and y % 3)
    }
    return _open(cells)


def scattered(side: int, share: float, seed: int) -> Floor:
    """Obstacles at random; only the largest part whose cells reach each other is used."""
    every = [(x, y) for x in range(side) for y in range(side)]
    return _open(
        _largest(set(every) - set(random.Random(seed).sample(every, round(share * side**2))))
    )


def octile(file: FilePath) -> Floor:
    """A grid in MovingAI's text form."""
    rows = file.read_text().splitlines()[4:]
    cells = {(x, y) for y, row in enumerate(rows) for x, c in enumerate(row) if c not in "@OTW"}
    return _open(_largest(cells))


def _largest(cells: set[XY]) -> set[XY]:
    best: set[XY] = set()
    left = set(cells)
    while len(left) > len(best):
        part, edge = set[XY](), [min(left)]
        while edge:
            x, y = edge.pop()
            if (x, y) in left:
                left.discard((x, y))
                part.add((x, y))
                edge += [(x + dx, y + dy) for dx, dy in AROUND]
        best = max(best, part, key=len)
    return best
