"""Who has a way and does not get on with it: frozen, or behind somebody who is.

What is committed is driven in the order of its numbers, so whoever has stood for long on its way
waits, in the end, for one that does not drive though it may. Nobody can send such a robot away.
"""

from collections.abc import Iterable

from ledger.ids import RobotName
from ledger.link import Mark
from scheduler.traffic.track import Track

# A late robot takes 6 s on average; ways that counted on a frozen one were found, and given up,
# again and again for minutes (40 robots on a lattice with faults), and kept all others waiting.
HALTED_MS = 20_000


class Halts:
    """Remembers since when each robot has got no further. Pure: time comes in."""

    def __init__(self) -> None:
        """Nobody stands yet."""
        self._since: dict[RobotName, tuple[Mark, int]] = {}

    def look(self, tracks: Iterable[Track], now_ms: int) -> set[RobotName]:
        """Those who have stood on their way for long."""
        since: dict[RobotName, tuple[Mark, int]] = {}
        for track in tracks:
            if not track.driven:
                known = self._since.get(track.name, (track.progress, now_ms))
                since[track.name] = (
                    known if known[0] == track.progress else (track.progress, now_ms)
                )
        self._since = since
        return {name for name, (_, at_ms) in since.items() if now_ms - at_ms >= HALTED_MS}
