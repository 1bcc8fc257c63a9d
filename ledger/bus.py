"""How the processes talk: messages by key, questions with answers, and who is alive.

Keys are slash-separated; a subscription may end in `/**`. Handlers may run on a foreign thread
(zenoh's) and must only hand the message over. `MemoryBus` delivers at once, in the caller's thread.

core ─ `fleet/events` (`ledger.feed.Told`: one for each commit, and one each second) ─► everybody
core ─ answers `fleet/state` (the Fleet), `fleet/events/after` (`Told` behind a position)
core ─ answers `fleet/last` (JSON array of [Report, Plan]: the newest it knows of each robot)
scheduler ─ asks `fleet/propose` (JSON array of proposals) ─► core
robot ─ `scenes/S/robots/R/report` ─► scheduler, core
robot is there as long as its token is: `scenes/S/robots/R/alive`
scheduler ─ `scenes/S/robots/R/tell` ─► robot
scheduler ─ `scenes/S/plans`, `scenes/S/counts` (Counts of traffic) ─► core
door or lift ─ `scenes/S/doors/ID/report`, `scenes/S/lifts/ID/report` ─► scheduler, core
scheduler ─ `scenes/S/doors/ID/tell`, `scenes/S/lifts/ID/tell` ─► door or lift
scheduler ─ `scenes/S/doors` (JSON array of DoorState) ─► core
"""

from collections import deque
from collections.abc import Callable, Iterable
from typing import Protocol, TypeAlias

from ledger.ids import RobotName, SceneId

EVENTS_KEY = "fleet/events"
EVENTS_AFTER_KEY = "fleet/events/after"
STATE_KEY = "fleet/state"
PROPOSE_KEY = "fleet/propose"
LAST_KEY = "fleet/last"

Handler: TypeAlias = Callable[[str, bytes], None]  # key, payload
Collected: TypeAlias = Callable[[], bytes | None]  # the oldest payload not yet fetched
Responder: TypeAlias = Callable[[bytes], Iterable[bytes]]  # question -> answers
Watcher: TypeAlias = Callable[[str, bool], None]  # key, alive
Listener: TypeAlias = tuple[str, Handler] | tuple[str, Watcher]  # who has asked for which keys


def report_key(scene: SceneId, robot: RobotName) -> str:
    """Where a robot publishes its reports."""
    return f"scenes/{scene}/robots/{robot}/report"


def tell_key(scene: SceneId, robot: RobotName) -> str:
    """Where a robot listens."""
    return f"scenes/{scene}/robots/{robot}/tell"


def alive_key(scene: SceneId, robot: RobotName) -> str:
    """The token that stands for as long as the robot is connected."""
    return f"scenes/{scene}/robots/{robot}/alive"


def plans_key(scene: SceneId) -> str:
    """Where the scheduler publishes what it intends, for those who look on."""
    return f"scenes/{scene}/plans"


def counts_key(scene: SceneId) -> str:
    """Where the scheduler publishes what it has counted, for those who look on."""
    return f"scenes/{scene}/counts"


def door_report_key(scene: SceneId, door: int) -> str:
    """Where a door publishes its reports."""
    return f"scenes/{scene}/doors/{door}/report"


def door_tell_key(scene: SceneId, door: int) -> str:
    """Where a door listens."""
    return f"scenes/{scene}/doors/{door}/tell"


def lift_report_key(scene: SceneId, lift: int) -> str:
    """Where a lift publishes its reports."""
    return f"scenes/{scene}/lifts/{lift}/report"


def lift_tell_key(scene: SceneId, lift: int) -> str:
    """Where a lift listens."""
    return f"scenes/{scene}/lifts/{lift}/tell"


def doors_key(scene: SceneId) -> str:
    """Where the scheduler publishes for whom doors are open, for those who look on."""
    return f"scenes/{scene}/doors"


class Bus(Protocol):
    """What a process needs of the others. Close it in a `finally`: zenoh threads outlive main."""

    def publish(self, key: str, payload: bytes) -> None:
        """Send to all who subscribe now; nobody else will ever see it."""

    def subscribe(self, key: str, handler: Handler) -> None:
        """Get every message published under the key from now on."""

    def collect(self, key: str, most: int) -> Collected:
        """Keep messages under the key until they are fetched, the newest `most` of them.

        For floods: a handler costs several times as much per message as fetching many at once.
        """

    def respond(self, key: str, responder: Responder) -> None:
        """Answer the questions asked under the key."""

    def ask(self, key: str, payload: bytes = b"", timeout_s: float = 5.0) -> list[bytes]:
        """Ask, and wait for all answers; raises TimeoutError where nobody answers."""

    def live(self, key: str) -> Callable[[], None]:
        """Hold a token; the returned function lets it go, and so does the end of the process."""

    def watch(self, key: str, watcher: Watcher) -> None:
        """Learn of tokens that exist, appear and vanish."""

    def close(self) -> None:
        """Leave; tokens vanish."""


def _matches(pattern: str, key: str) -> bool:
    if pattern.endswith("/**"):
        return key.startswith(pattern[:-2])
    wanted, parts = pattern.split("/"), key.split("/")
    return len(wanted) == len(parts) and all(
        w in ("*", p) for w, p in zip(wanted, parts, strict=True)
    )


class MemoryBus:
    """The bus within one process: everything is delivered before `publish` returns."""

    def __init__(self) -> None:
        self._handlers: list[tuple[str, Handler]] = []
        self._heard_by: dict[str, tuple[Handler, ...]] = {}  # by key, found once
        self._responders: dict[str, Responder] = {}
        self._watchers: list[tuple[str, Watcher]] = []
        self._tokens: dict[str, int] = {}

    def publish(self, key: str, payload: bytes) -> None:
        """Deliver to every matching subscription, first subscribed first."""
        handlers = self._heard_by.get(key)
        if handlers is None:
            found = (handler for pattern, handler in self._handlers if _matches(pattern, key))
            handlers = self._heard_by[key] = tuple(found)
        for handler in handlers:
            handler(key, payload)

    def subscribe(self, key: str, handler: Handler) -> None:
        """Deliver matching messages to the handler from now on."""
        self._handlers.append((key, handler))
        self._heard_by.clear()

    def listeners(self) -> tuple[Listener, ...]:
        """Give all subscriptions and watches."""
        return (*self._handlers, *self._watchers)

    def end(self, listeners: Iterable[Listener]) -> None:
        """Deliver nothing more to these: who made them is gone."""
        gone = {id(listener) for listener in listeners}
        self._handlers[:] = [entry for entry in self._handlers if id(entry) not in gone]
        self._watchers[:] = [entry for entry in self._watchers if id(entry) not in gone]
        self._heard_by.clear()

    def collect(self, key: str, most: int) -> Collected:
        """Keep the newest messages until they are fetched."""
        kept: deque[bytes] = deque(maxlen=most)
        self.subscribe(key, lambda _, payload: kept.append(payload))
        return lambda: kept.popleft() if kept else None

    def respond(self, key: str, responder: Responder) -> None:
        """Answer the questions asked under the key."""
        self._responders[key] = responder

    def ask(self, key: str, payload: bytes = b"", timeout_s: float = 5.0) -> list[bytes]:
        """Ask the one responder of the key."""
        if key not in self._responders:
            raise TimeoutError(f"nobody answers {key}")
        return list(self._responders[key](payload))

    def live(self, key: str) -> Callable[[], None]:
        """Hold a token until the returned function is called."""
        self._tokens[key] = self._tokens.get(key, 0) + 1
        self._tell(key, alive=True)

        def let_go() -> None:
            left = self._tokens.pop(key, 0) - 1
            if left > 0:
                self._tokens[key] = left
            elif left == 0:
                self._tell(key, alive=False)

        return let_go

    def watch(self, key: str, watcher: Watcher) -> None:
        """Tell of existing tokens at once, and of changes from now on."""
        self._watchers.append((key, watcher))
        for token in tuple(self._tokens):
            if _matches(key, token):
                watcher(token, True)

    def _tell(self, key: str, *, alive: bool) -> None:
        for pattern, watcher in tuple(self._watchers):
            if _matches(pattern, key):
                watcher(key, alive)

    def close(self) -> None:
        """Let all tokens go."""
        for key in tuple(self._tokens):
            del self._tokens[key]
            self._tell(key, alive=False)
