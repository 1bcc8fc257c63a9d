"""From an area and its robot groups to a `Roadmap`, kept on disk under a digest of both."""

import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Any
from zipfile import BadZipFile

import msgspec
import numpy as np
import numpy.typing as npt

from ledger.scene import Area, Group
from scheduler.traffic.cells import Cells, lay_out
from scheduler.traffic.classes import Classes
from scheduler.traffic.geometry import MARGIN_M, PIECE_M, Floats
from scheduler.traffic.hindrance import hindrance
from scheduler.traffic.moves import Finder, Moves
from scheduler.traffic.network import Network, network
from scheduler.traffic.pockets import find
from scheduler.traffic.roadmap import Roadmap
from scheduler.traffic.stops import Places, choose

PART_M = 3.0  # paths of twice this length and more are cut into parts of at least this
# Where robots are much in each other's way, as on open grids, fewer stops are tried as well.
THIRD_PARTIES = 1.0
APART_M = 0.3  # more than they must be from each other
BETTER = 0.9  # below this share of the hindrance they are taken: a tie is decided for more stops
COMPILER = 8  # grows whenever the same area gives another roadmap


def digest_of(area: Area, groups: Sequence[Group]) -> str:
    """Names a roadmap: everything that it depends on, nothing else (names and walls do not)."""
    what = (
        COMPILER,
        PIECE_M,
        MARGIN_M,
        PART_M,
        area.points,
        area.paths,
        sorted({bin.point for bin in area.bins}),
        sorted(groups, key=lambda group: group.id),
    )
    return hashlib.sha256(msgspec.json.encode(what, order="deterministic")).hexdigest()[:32]


def compile_area(area: Area, groups: Sequence[Group], cache: FilePath | None = None) -> Roadmap:
    """Compile, or load what was compiled before; `cache` is a folder, made if missing.

    A cache file that cannot be read is made anew: it holds nothing that is not in the area.
    """
    groups = sorted(groups, key=lambda group: group.id)
    digest = digest_of(area, groups)
    file = None if cache is None else cache / f"roadmap-{digest}.npz"
    net = network(area, PART_M)
    classes = Classes(groups)
    parts = None if file is None else _load(file)
    if parts is None:
        parts = _compile(net, classes.footprints, groups[0])
        if file is not None:
            _save(file, *parts)
    cells, places, moves = parts
    lengths = [sum(net.traces.length_m[path] for path in paths) for paths in moves.paths]
    return Roadmap(
        digest=digest,
        area=area,
        net=net,
        groups=groups,
        classes=classes,
        cells=cells,
        places=places,
        moves=moves,
        pockets=find(places, moves, lengths),
    )


def _compile(net: Network, footprints: list[Floats], group: Group) -> tuple[Cells, Places, Moves]:
    xy = np.array([(point.x_m, point.y_m) for point in net.points]).reshape(-1, 2)
    cells = lay_out(net.traces, footprints, xy, net.headings)
    widest = len(footprints) - 1
    places = choose(net, cells, widest)
    moves = Finder(net, cells, places, widest, group.kinematics).all()
    if _third_parties(places, moves) > THIRD_PARTIES:
        fewer = choose(net, cells, widest, APART_M)
        wider = Finder(net, cells, fewer, widest, group.kinematics).all()
        if hindrance(net, fewer, wider) < BETTER * hindrance(net, places, moves):
            places, moves = fewer, wider
    return cells, places, moves


def _third_parties(places: Places, moves: Moves) -> float:
    """Stops beside its end that a move needs empty, in the mean."""
    stops = (1 << places.stops) - 1
    found = [(need & stops).bit_count() for need in moves.need]
    return sum(found) / len(found) - 1.0 if found else 0.0


def _bits_to_csr(rows: Sequence[int]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    lists = []
    for row in rows:
        found = []
        while row:
            low = row & -row
            found.append(low.bit_length() - 1)
            row ^= low
        lists.append(found)
    return _to_csr(lists)


def _to_csr(
    lists: Sequence[Sequence[int]],
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    indptr = np.concatenate(([0], np.cumsum([len(row) for row in lists]))).astype(np.int32)
    flat = [value for row in lists for value in row]
    return indptr, np.asarray(flat, dtype=np.int32)


def _from_csr(
    indptr: npt.NDArray[np.int32], indices: npt.NDArray[np.int32]
) -> list[tuple[int, ...]]:
    bounds, values = indptr.tolist(), indices.tolist()
    return [tuple(values[a:b]) for a, b in pairwise(bounds)]


def _bits_from_csr(indptr: npt.NDArray[np.int32], indices: npt.NDArray[np.int32]) -> list[int]:
    rows = []
    for row in _from_csr(indptr, indices):
        bits = 0
        for value in row:
            bits |= 1 << value
        rows.append(bits)
    return rows


def _save(file: FilePath, cells: Cells, places: Places, moves: Moves) -> None:
    """Written beside and renamed, so that no reader ever sees half a file."""
    rest_cells = list(places.resting)
    arrays: dict[str, npt.NDArray[Any]] = {
        "sizes": np.array([cells.pieces, cells.points, cells.checked, cells.disagreed]),
        "cell": cells.cell,
        "corners": cells.corners,
        "offsets": cells.offsets,
        "indptr": cells.indptr,
        "indices": cells.indices,
        "place": np.array([places.stops, *places.point]),
        "start": np.array(moves.start, dtype=np.int32),
        "end": np.array(moves.end, dtype=np.int32),
        "retreats": np.array(sorted(moves.retreats), dtype=np.int32),
        "rest": np.array(rest_cells, dtype=np.int32),
    }
    rows = {
        "paths": _to_csr(moves.paths),
        "need": _bits_to_csr(moves.need),
        "conflict": _bits_to_csr(places.conflict),
        "turning": _bits_to_csr(places.turning),
        "resting": _bits_to_csr([places.resting[cell] for cell in rest_cells]),
    }
    for name, (indptr, indices) in rows.items():
        arrays[f"{name}_indptr"], arrays[f"{name}_indices"] = indptr, indices
    beside = file.with_suffix(f".{os.getpid()}.tmp")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as out:
            np.savez(out, **arrays)  # type: ignore[arg-type]
        beside.replace(file)
    except OSError:  # a full disk, say: it is a cache, and the next start compiles again
        with suppress(OSError):
            beside.unlink(missing_ok=True)


def _load(file: FilePath) -> tuple[Cells, Places, Moves] | None:
    try:
        with file.open("rb") as raw, np.load(raw, allow_pickle=False) as kept:
            arrays = {name: kept[name] for name in kept.files}
            return _unpack(arrays)
    except (OSError, ValueError, KeyError, BadZipFile, EOFError):
        return None


def _unpack(arrays: dict[str, npt.NDArray[Any]]) -> tuple[Cells, Places, Moves]:
    def bits(name: str) -> list[int]:
        return _bits_from_csr(arrays[f"{name}_indptr"], arrays[f"{name}_indices"])

    pieces, points, checked, disagreed = arrays["sizes"].tolist()
    cells = Cells(
        pieces=pieces,
        points=points,
        cell=arrays["cell"],
        corners=arrays["corners"],
        offsets=arrays["offsets"],
        indptr=arrays["indptr"],
        indices=arrays["indices"],
        checked=checked,
        disagreed=disagreed,
    )
    stops, *point = arrays["place"].tolist()
    places = Places(
        point=point,
        stops=stops,
        conflict=bits("conflict"),
        resting=dict(zip(arrays["rest"].tolist(), bits("resting"), strict=True)),
        turning=bits("turning"),
    )
    moves = Moves(
        start=arrays["start"].tolist(),
        end=arrays["end"].tolist(),
        paths=_from_csr(arrays["paths_indptr"], arrays["paths_indices"]),
        need=bits("need"),
        retreats=frozenset(arrays["retreats"].tolist()),
    )
    return cells, places, moves
