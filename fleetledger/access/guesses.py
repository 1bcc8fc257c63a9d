"""Against guessing: after some failures the next try has to wait, twice as long each time."""

from collections.abc import Hashable
from typing import TypeAlias

from ledger.scene import Value

USER_FREE, USER_WAIT_S_MAX = 5, 60.0  # a guesser must not be able to lock a person out for long
ADDRESS_FREE, ADDRESS_WAIT_S_MAX = 20, 900.0  # many people may sign in from behind one address
FORGOTTEN_AFTER_S = 3_600.0
KNOWN_MAX = 10_000  # users or addresses; the ones that failed longest ago are forgotten first

Who: TypeAlias = Hashable


class _Failures(Value, frozen=True, kw_only=True):
    count: int
    last_s: float


class Guesses:
    """Failures by user, or by address."""

    def __init__(self, free: int, wait_s_max: float) -> None:
        """Take how many failures cost nothing, and the longest wait."""
        self._free = free
        self._wait_s_max = wait_s_max
        self._known: dict[Who, _Failures] = {}  # the one that failed last stands last

    def wait_s(self, who: Who, now_s: float) -> float:
        """Tell how long to wait until the next try; 0 = none."""
        failures = self._known.get(who)
        if failures is None or failures.count < self._free:
            return 0.0
        doublings = min(failures.count - self._free, 30)
        wait_s = min(2.0**doublings, self._wait_s_max)
        return max(0.0, failures.last_s + wait_s - now_s)

    def failed(self, who: Who, now_s: float) -> None:
        """Count a try, before its outcome is known: tries at once must not count as one."""
        before = self._known.pop(who, None)
        forgotten = before is None or now_s - before.last_s > FORGOTTEN_AFTER_S
        count = 1 if before is None or forgotten else before.count + 1
        self._known[who] = _Failures(count=count, last_s=now_s)
        while len(self._known) > KNOWN_MAX:
            del self._known[next(iter(self._known))]

    def succeeded(self, who: Who) -> None:
        """Forget a person's failures."""
        self._known.pop(who, None)

    def forgive(self, who: Who) -> None:
        """Take one failure back: that try was right after all."""
        failures = self._known.get(who)
        if failures is None:
            return
        if failures.count <= 1:
            del self._known[who]
        else:
            self._known[who] = _Failures(count=failures.count - 1, last_s=failures.last_s)


class Attempts:
    """Tries to sign in, limited for each user and for each address."""

    def __init__(self) -> None:
        """Begin with nobody suspect."""
        self._users = Guesses(USER_FREE, USER_WAIT_S_MAX)
        self._addresses = Guesses(ADDRESS_FREE, ADDRESS_WAIT_S_MAX)

    def begin(self, user: str, address: str, now_s: float) -> float:
        """Count the try as failed and give 0.0, or count nothing and tell how long to wait."""
        user_s = self._users.wait_s(user, now_s)
        wait_s = max(user_s, self._addresses.wait_s(address, now_s))
        if wait_s == 0.0:
            self._users.failed(user, now_s)
            self._addresses.failed(address, now_s)
        return wait_s

    def right(self, user: str, address: str) -> None:
        """Tell that the try was right: the user starts anew, the address loses that one.

        Who has one password of his own must not thereby get more guesses at others'.
        """
        self._users.succeeded(user)
        self._addresses.forgive(address)

    def undo(self, user: str, address: str) -> None:
        """Tell that the try was not looked at."""
        self._users.forgive(user)
        self._addresses.forgive(address)
