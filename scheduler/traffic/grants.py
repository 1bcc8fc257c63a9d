"""The grant table: the one authority over who may be where.

A committed move *promises* its cells under a commit number; its robot then *acquires* them one by
one, in the order of its route, and releases them as it leaves them. A cell is acquired only while
nobody else owns a cell that overlaps it and no lower commit is promised one. So owners exclude each
other however late anyone is, and whoever waits, waits for a lower number: what is committed can
always be driven to its end.
"""

from collections.abc import Callable, Iterable

from ledger.scene import XY


class Grants:
    """Owners and promises of cells. Owners are robots, or any name a claim is made in."""

    def __init__(self, conflicts: Callable[[int], tuple[int, ...]], cells: int) -> None:
        """`conflicts` gives the cells excluded by one, itself included; `cells` counts them."""
        self._static = conflicts
        self._cells = cells
        self._owner: dict[int, dict[str, int]] = {}  # cell -> owner -> how often
        self._promises: dict[int, list[tuple[int, str]]] = {}  # cell -> ascending commits
        self._shapes: dict[int, tuple[int, ...]] = {}  # foreign shape -> cells it excludes
        self._rings: dict[int, tuple[XY, ...]] = {}
        self._extra: dict[int, list[int]] = {}  # cell -> foreign shapes over it
        self._next = cells

    # -- shapes that are no compiled cells: robots off their points, foreign claims

    def add_shape(self, ring: tuple[XY, ...], overlapped: Iterable[int]) -> int:
        """Make a cell of a foreign shape over these cells, and return its number."""
        shape = self._next
        self._next += 1
        self._shapes[shape] = (shape, *overlapped)
        self._rings[shape] = ring
        for cell in self._shapes[shape][1:]:
            self._extra.setdefault(cell, []).append(shape)
        return shape

    def _drop_shape(self, shape: int) -> None:
        for cell in self._shapes.pop(shape)[1:]:
            if cell in self._extra:
                self._extra[cell].remove(shape)
                if not self._extra[cell]:
                    del self._extra[cell]
        del self._rings[shape]
        self._extra.pop(shape, None)

    def discard(self, cell: int) -> None:
        """Forget a foreign shape that nobody owns or is promised; nothing of any other cell."""
        if cell in self._shapes and cell not in self._promises and cell not in self._owner:
            self._drop_shape(cell)

    def shapes(self) -> dict[int, tuple[XY, ...]]:
        """All foreign shapes and their corners."""
        return self._rings

    def is_shape(self, cell: int) -> bool:
        """Is this cell a foreign shape."""
        return cell >= self._cells

    def ring(self, shape: int) -> tuple[XY, ...]:
        """Corners of a foreign shape."""
        return self._rings[shape]

    def excluded(self, cell: int) -> tuple[int, ...]:
        """Cells that may not be owned by others together with this one; itself first."""
        fixed = self._shapes.get(cell) if cell >= self._cells else self._static(cell)
        if fixed is None:
            return (cell,)
        extra = self._extra.get(cell)
        return (*fixed, *extra) if extra else fixed

    # -- owning

    def blockers(self, cell: int, owner: str, commit: int) -> list[str]:
        """Who keeps this owner from acquiring the cell under this commit; empty = nobody."""
        owned, promises = self._owner, self._promises
        found = []
        for other in self.excluded(cell):
            holders = owned.get(other)
            if holders is not None:
                found += [name for name in holders if name != owner]
            queue = promises.get(other)
            if queue is not None:
                for number, name in queue:
                    if number >= commit:
                        break
                    if name != owner:
                        found.append(name)
        return found

    def free(self, cell: int, owner: str, commit: int) -> bool:
        """May this owner acquire the cell under this commit number now."""
        owned, promises = self._owner, self._promises
        for other in self.excluded(cell):
            holders = owned.get(other)
            if holders is not None and (len(holders) > 1 or owner not in holders):
                return False
            queue = promises.get(other)
            if queue is not None:
                for number, name in queue:
                    if number >= commit:
                        break
                    if name != owner:
                        return False
        return True

    def awaited(self, cell: int, owner: str, commit: int) -> bool:
        """Is ground that excludes the cell promised to another under a later commit than this."""
        return any(
            number > commit and name != owner
            for other in self.excluded(cell)
            for number, name in self._promises.get(other, ())
        )

    def take(self, cell: int, owner: str) -> None:
        """Own a cell, asked or not: `free` is the caller's to ask, but where a body already is."""
        holders = self._owner.setdefault(cell, {})
        holders[owner] = holders.get(owner, 0) + 1

    def release(self, cell: int, owner: str) -> None:
        """Own it once less; a foreign shape ends with its last owner."""
        holders = self._owner[cell]
        holders[owner] -= 1
        if not holders[owner]:
            del holders[owner]
            if not holders:
                del self._owner[cell]
                self.discard(cell)

    def owners(self, cell: int) -> list[str]:
        """Who owns exactly this cell."""
        return sorted(self._owner.get(cell, ()))

    # -- promising

    def promised(self, cell: int) -> list[str]:
        """Who is promised exactly this cell."""
        return [name for _, name in self._promises.get(cell, ())]

    def promise(self, cell: int, owner: str, commit: int) -> None:
        """Queue for a cell; most promises are the newest, so they go to the end."""
        queue = self._promises.setdefault(cell, [])
        queue.append((commit, owner))
        if len(queue) > 1 and queue[-2] > queue[-1]:
            queue.sort()

    def fulfil(self, cell: int, owner: str, commit: int) -> None:
        """A promised cell becomes owned."""
        self._unqueue(cell, owner, commit)
        self.take(cell, owner)

    def withdraw(self, cell: int, owner: str, commit: int) -> None:
        """Take a promise back."""
        self._unqueue(cell, owner, commit)
        self.discard(cell)

    def _unqueue(self, cell: int, owner: str, commit: int) -> None:
        queue = self._promises[cell]
        queue.remove((commit, owner))
        if not queue:
            del self._promises[cell]
