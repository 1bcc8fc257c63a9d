"""Which charging and parking points are free: no robot rests there, none is on its way there."""

from collections.abc import Iterator

from ledger.ids import PointName, RobotName
from ledger.proposals import AnyProposal, AssignOrder, CreateSystemOrder
from ledger.scene import PointKind
from ledger.state import BinStatus, StepStatus
from scheduler.places import Place
from scheduler.view import RobotView, View


class Spots:
    """The points of one kind in one pass, taken one after another."""

    def __init__(self, view: View, so_far: tuple[AnyProposal, ...], kind: PointKind) -> None:
        self._view = view
        wanted = set(_goals(view, so_far))
        self._standing: dict[PointName, RobotName] = {
            robot.report.point: name
            for name, robot in view.robots.items()
            if robot.report is not None and robot.report.point is not None
        }
        self._free: list[Place] = [
            place
            for name, place in sorted(view.places.items())
            if place.point.name == name and place.point.kind is kind and name not in wanted
        ]

    def take_nearest(
        self, robot: RobotView, *, but: PointName | None = None
    ) -> tuple[str, float] | None:
        """Take the nearest point that is free for this robot, with its cost; none = stay."""
        best: tuple[float, str, Place] | None = None
        for place in self._free:
            name = place.point.name
            if name == but or self._standing.get(name, robot.name) != robot.name:
                continue
            cost_s = self._view.cost_s(robot, place)
            if cost_s < float("inf") and (best is None or (cost_s, name) < best[:2]):
                best = (cost_s, name, place)
        if best is None:
            return None
        self._free.remove(best[2])
        return best[1], round(best[0], 3)


def _goals(view: View, so_far: tuple[AnyProposal, ...]) -> Iterator[str]:
    """Give the points that orders with a robot still lead to, those of this pass included."""
    for robot in view.robots.values():
        for order in robot.orders:
            for step in order.steps:
                if step.status in (StepStatus.EXECUTABLE, StepStatus.EXECUTING):
                    place = view.place(step.task.location)
                    if place is not None:
                        yield place.point.name
    for proposal in so_far:
        if isinstance(proposal, CreateSystemOrder):
            yield proposal.location


def engaged(so_far: tuple[AnyProposal, ...]) -> set[RobotName]:
    """Give the robots that got an order in this pass."""
    return {p.robot for p in so_far if isinstance(p, AssignOrder | CreateSystemOrder)}


def is_idle(robot: RobotView) -> bool:
    """Tell whether the system may send it somewhere: in service, no order, a bin to book it on.

    Off duty or not: such a robot takes no orders of others, but must not run empty in the way.
    """
    state = robot.robot
    in_service = state.online and not state.config.disabled
    empty = any(b.status is BinStatus.EMPTY for b in state.bins)
    return in_service and robot.ready and not state.orders and empty
