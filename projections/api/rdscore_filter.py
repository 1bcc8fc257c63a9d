"""The `paths` of RDSCore: what a filtered answer keeps (spec/rdscore.md §3)."""

from collections.abc import Iterable
from typing import Any

from ledger.errors import Refused

PATHS_MAX = 200
DEPTH_MAX = 20

Tree = dict[str, Any]  # name of a level -> what is wanted below it; empty = all


def tree(paths: Iterable[str]) -> Tree:
    """Merge paths like `report.rbk_report.x` into one tree; a path to an object wins over deeper
    ones, for it asks for the whole.
    """
    wanted: Tree = {}
    for number, path in enumerate(paths):
        levels = [level.strip() for level in path.split(".")]
        if number >= PATHS_MAX or len(levels) > DEPTH_MAX:
            words = f"'paths' may have {PATHS_MAX} paths of {DEPTH_MAX} levels."
            raise Refused("50001", words, PATHS_MAX, DEPTH_MAX)
        _add(wanted, levels)
    return wanted


def _add(wanted: Tree, levels: list[str]) -> None:
    first, *rest = levels
    if not rest:
        wanted[first] = {}
    elif first not in wanted:
        wanted[first] = {}
        _add(wanted[first], rest)
    elif wanted[first]:
        _add(wanted[first], rest)


def selected(value: Any, wanted: Tree) -> Any:
    """Give the wanted part; lists are crossed without an index, and empty ones become null."""
    if isinstance(value, list):
        return [selected(item, wanted) for item in value] or None
    if not isinstance(value, dict):
        return value
    if not wanted:
        return {name: selected(part, {}) for name, part in value.items()}
    return {
        name: selected(value[name], below)
        for name, below in wanted.items()
        if name in value and (not below or isinstance(value[name], dict | list))
    }
