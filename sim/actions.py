"""What a simulated robot does where it stands: bin tasks and operations that take time."""

from zlib import crc32

import msgspec

from ledger.link import Act, ActionPhase, ActionReport, Alarm, AlarmLevel

CHARGE = "Charge"
FAIL = "Fail"  # this operation fails whenever it is tried, for people who try out faults
ACTION_FAILED = "ActionFailed"
DURATION_S_MIN = 4.0
DURATION_S_RANGE = 2.0
REMEMBERED_MAX = 64  # ids of finished actions: a repeated one is not done twice


def duration_s(name: str) -> float:
    """Give the time an action takes: 4 to 6 s, always the same for one name."""
    return DURATION_S_MIN + crc32(name.encode()) % 1000 / 1000 * DURATION_S_RANGE


def must_fail(act: Act) -> bool:
    """Tell whether an action, or the operation that a bin task stands for, is the failing one."""
    if act.name == FAIL:
        return True
    try:
        arguments = msgspec.json.decode(act.arguments)
    except msgspec.DecodeError:
        return False
    return isinstance(arguments, dict) and arguments.get("operation") == FAIL


def action_failed(act: Act, before: Alarm | None) -> Alarm:
    """Raise the alarm of a failed action, once more if it stands already."""
    message = f"{act.name} failed"
    times = 1 if before is None else before.times + 1
    return Alarm(level=AlarmLevel.ERROR, code=ACTION_FAILED, message=message, times=times)


class Actions:
    """The action of one robot, one at a time, and what became of the ones before."""

    __slots__ = ("charging", "failing", "left_s", "newest", "reports")

    def __init__(self) -> None:
        self.charging = False  # Charge runs for as long as it is left alone
        self.failing: set[str] = set()  # names of actions that will fail next time
        self.left_s = 0.0
        self.newest: str | None = None  # id
        self.reports: dict[str, ActionReport] = {}  # by id, oldest first

    @property
    def report(self) -> ActionReport | None:
        """The last action that the robot was told."""
        return self.reports[self.newest] if self.newest is not None else None

    @property
    def running(self) -> bool:
        """One is under way."""
        report = self.report
        return report is not None and report.phase is ActionPhase.RUNNING

    def begin(self, act: Act, *, problem: str | None) -> None:
        """Start, or fail for the problem. While one runs another is not heard; tell it again."""
        if self.running:
            return
        if act.id in self.reports:
            self.newest = act.id
            return
        self.newest = act.id
        self.reports[act.id] = ActionReport(id=act.id, phase=ActionPhase.RUNNING)
        while len(self.reports) > REMEMBERED_MAX:
            del self.reports[next(iter(self.reports))]
        if problem is None and act.name in self.failing:
            self.failing.discard(act.name)
            problem = f"{act.name} failed, as asked for"
        if problem is not None:
            self._end(ActionPhase.FAILED, problem)
            return
        self.charging = act.name == CHARGE
        self.left_s = duration_s(act.name)

    def cancel(self, id: str) -> None:
        """Stop it if it runs. To stop is how charging ends well."""
        if not self.running or id != self.newest:
            return
        if self.charging:
            self.stop_charging()
        else:
            self._end(ActionPhase.FAILED, "cancelled")

    def stop_charging(self) -> None:
        """Leave the charger."""
        self.charging = False
        self._end(ActionPhase.DONE)

    def work(self, dt_s: float) -> None:
        """Let time pass."""
        if self.charging:
            return
        self.left_s -= dt_s
        if self.left_s <= 0.0:
            self._end(ActionPhase.DONE)

    def _end(self, phase: ActionPhase, message: str = "") -> None:
        assert self.newest is not None
        self.left_s = 0.0
        self.reports[self.newest] = ActionReport(id=self.newest, phase=phase, message=message)
