"""The numbers in a report that change as a robot drives, as small whole ones.

Motion is kept to the millimetre, a tenth of a milliradian, a millimetre a second, a hundredth of a
percent of battery and a centimetre on the odometer; everything else exactly. So a robot under way
costs about ten bytes a report instead of seven hundred.
"""

from collections.abc import Sequence
from operator import attrgetter, truediv
from typing import TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt

from ledger.link import Mark, Report

Numbers: TypeAlias = tuple[int, ...]  # one for each of MOTION
Table: TypeAlias = npt.NDArray[np.float64]  # (robots, MOTION)
Flags: TypeAlias = npt.NDArray[np.bool_]

# field, and how many steps make one of its unit
MOTION: dict[str, int] = {
    "number": 1,
    "at_ms": 1,
    "x_m": 1000,
    "y_m": 1000,
    "heading_rad": 10_000,
    "speed_mps": 1000,
    "turn_radps": 1000,
    "battery_ratio": 10_000,
    "odometer_m": 100,
    "odometer_today_m": 100,
    "progress.piece": 1,
    "progress.along_m": 1000,
    "authority.piece": 1,
    "authority.along_m": 1000,
}
AT = 1  # place of at_ms
HAPPENS = 2  # from here on a change means that something has happened
NUMBER_MAX = 2**53  # beyond it a step is not exact any more

_SCALES = tuple(MOTION.values())
_motion = attrgetter(*MOTION)
_ASIDE = {name.partition(".")[0] for name in MOTION} | {"point", "scene", "robot"}
steady = attrgetter(*(name for name in Report.__struct_fields__ if name not in _ASIDE))


def table(reports: Sequence[Report]) -> Table:
    """Give the motion of many in whole steps, a row each."""
    if not reports:
        return np.empty((0, len(MOTION)))
    with np.errstate(over="ignore"):  # infinite once it is multiplied
        steps = np.array([_motion(r) for r in reports], dtype=np.float64) * _SCALES
    return np.rint(np.clip(steps, -2 * NUMBER_MAX, 2 * NUMBER_MAX))


def is_exact(rows: Table) -> Flags:
    """Tell for each row whether no number is too great for steps to be counted in it."""
    return np.asarray((np.abs(rows) < NUMBER_MAX).all(axis=1), dtype=np.bool_)


def grown(rows: Table, count: int) -> Table:
    """Make room for so many rows."""
    if count <= len(rows):
        return rows
    return np.concatenate([rows, np.zeros((count, len(MOTION)))])


def numbers(report: Report) -> Numbers | None:
    """Give the motion of one in whole steps; None where a number is too great for that."""
    rows = table([report])
    return tuple(map(int, rows[0])) if is_exact(rows)[0] else None


def moved(report: Report, motion: Sequence[int], point: str | None) -> Report:
    """Give a report with another motion."""
    values = dict(zip(MOTION, map(truediv, motion, _SCALES), strict=True))
    marks = {
        name: Mark(piece=int(values.pop(f"{name}.piece")), along_m=values.pop(f"{name}.along_m"))
        for name in ("progress", "authority")
    }
    whole = {name: int(values.pop(name)) for name in ("number", "at_ms")}
    return msgspec.structs.replace(report, point=point, **whole, **values, **marks)
