"""Stops robots for what traffic's guard sees, and lets them go: through the core, on record.

The stop is an operator's soft stop with a reason. So it stands in the ledger and in the robot's own
report, outlives every restart, and an operator may lift it, for this once, whatever the guard says.
"""

from collections.abc import Mapping, Sequence

import msgspec

from ledger.ids import RobotName, SceneId
from ledger.link import DISPATCHER, Alarm, AlarmLevel, InstructionKind, Plan, Report
from ledger.proposals import AnyProposal, LiftStop, StopRobot
from ledger.state import Robot
from scheduler.roads import TrafficLike
from scheduler.traffic.guard import Breach


class Watchman:
    """One per scene. It remembers only who was stopped in a breach that is not over."""

    def __init__(self) -> None:
        """Begin with nobody."""
        self._held: dict[RobotName, tuple[Breach, int]] = {}  # as first seen, and since when
        self._stopped: set[RobotName] = set()  # and seen to be so, in the state

    def look(
        self,
        scene: SceneId,
        robots: Sequence[Robot],
        reports: Mapping[RobotName, Report],
        traffic: Mapping[int, TrafficLike],
        now_ms: int,
    ) -> list[AnyProposal]:
        """Propose stops and their end; one that obeys somebody else is that one's to stop."""
        breaches = [breach for area in traffic.values() for breach in area.look(now_ms)]
        self._held = {
            name: self._held.get(name, (breach, now_ms))
            for breach in breaches
            for name in breach.stopped
        }
        settled = all(area.ready for area in traffic.values())
        proposals: list[AnyProposal] = []
        for robot in robots:
            stop, name = robot.told(InstructionKind.SOFT_STOP), robot.name
            is_stopped = stop is not None and stop.on
            if name not in self._held:
                self._stopped.discard(name)
                if stop is not None and stop.on and stop.reason and settled:
                    proposals.append(LiftStop(scene=scene, robot=name))
            elif is_stopped:
                self._stopped.add(name)
            elif name in self._stopped:  # an operator knows better
                for area in traffic.values():
                    area.excuse(name)
            elif name in reports and reports[name].controller == DISPATCHER:
                reason = self._held[name][0].words
                proposals.append(StopRobot(scene=scene, robot=name, reason=reason))
        return proposals

    def alarmed(self, plan: Plan) -> Plan:
        """Put the alarm of a breach on the plan of a robot that is held for it."""
        if plan.robot not in self._held:
            return plan
        breach, since_ms = self._held[plan.robot]
        alarm = Alarm(
            level=AlarmLevel.FATAL, code=breach.kind, message=breach.words, at_ms=since_ms
        )
        return msgspec.structs.replace(plan, alarm=alarm)
