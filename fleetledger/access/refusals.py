"""Refused calls on their way to the ledger: alike ones are counted together.

However many calls come, an address leads to a few events a minute, and all of them to not many
more: nobody can fill the disk by being refused.
"""

from collections.abc import Iterable

from ledger.events import AccessRefused
from ledger.ids import SceneId
from ledger.scene import Value

KINDS_MAX = 200  # told apart within a minute
OF_ADDRESS_MAX = 10
CALL_CHARS_MAX = 200
REST = "…"


class _Kind(Value, frozen=True, kw_only=True):
    caller: str
    address: str
    call: str
    code: str


class Refusals:
    """What was refused since the last `taken`."""

    def __init__(self) -> None:
        """Begin with none."""
        self._counts: dict[_Kind, int] = {}
        self._of_address: dict[str, int] = {}

    def refused(self, caller: str, address: str, call: str, code: str, count: int = 1) -> None:
        """Count it. Kinds beyond the limits are counted by address, or all together."""
        kind = _Kind(caller=caller, address=address, call=call[:CALL_CHARS_MAX], code=code)
        if kind not in self._counts and not self._has_room(address):
            address = address if address in self._of_address else REST
            kind = _Kind(caller=REST, address=address, call=REST, code=code)
        if kind not in self._counts:
            self._of_address[kind.address] = self._of_address.get(kind.address, 0) + 1
        self._counts[kind] = self._counts.get(kind, 0) + count

    def taken(self) -> tuple[AccessRefused, ...]:
        """Give the events of what was counted, and begin anew."""
        counts, self._counts, self._of_address = self._counts, {}, {}
        return tuple(
            AccessRefused(
                scene=SceneId(""),
                caller=kind.caller,
                address=kind.address,
                call=kind.call,
                code=kind.code,
                count=count,
            )
            for kind, count in counts.items()
        )

    def put_back(self, refused: Iterable[AccessRefused]) -> None:
        """Count again what could not be told."""
        for event in refused:
            self.refused(event.caller, event.address, event.call, event.code, event.count)

    def _has_room(self, address: str) -> bool:
        few = self._of_address.get(address, 0) < OF_ADDRESS_MAX
        return few and len(self._counts) < KINDS_MAX
