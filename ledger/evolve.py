"""What each event means: the fold that gives the state. It never refuses an event."""

from collections.abc import Iterable
from typing import assert_never

from ledger.events import (
    AccessEvent,
    AnswerEvent,
    AnyEvent,
    DeviceEvent,
    OrderCreated,
    OrderEvent,
    ResourceEvent,
    RobotsWaited,
    SceneEvent,
)
from ledger.events.orders import OfOrder
from ledger.events.robots import OfRobot
from ledger.evolve_answers import evolve_answer
from ledger.evolve_order import order_after, order_created
from ledger.evolve_resources import evolve_device, evolve_resource
from ledger.evolve_robot import evolve_carrier, evolve_robot
from ledger.evolve_scene import evolve_scene
from ledger.state import Fleet


def fold(fleet: Fleet, events: Iterable[AnyEvent]) -> Fleet:
    """Evolve through all events, in order."""
    for event in events:
        evolve(fleet, event)
    return fleet


def evolve(fleet: Fleet, event: AnyEvent) -> None:
    """Take one event into the state; the most frequent kinds are looked for first."""
    if isinstance(event, OfOrder):
        _evolve_order(fleet, event)
    elif isinstance(event, OfRobot):
        evolve_robot(fleet, event)
    elif isinstance(event, AnswerEvent):
        evolve_answer(fleet, event)
    elif isinstance(event, SceneEvent):
        evolve_scene(fleet, event)
    elif isinstance(event, ResourceEvent):
        evolve_resource(fleet, event)
    elif isinstance(event, DeviceEvent):
        evolve_device(fleet, event)
    elif not isinstance(event, AccessEvent | RobotsWaited):
        # who may call is kept elsewhere, and these are its audit; what has been waited is history
        assert_never(event)
    fleet.position = event.position
    fleet.at_ms = event.at_ms


def _evolve_order(fleet: Fleet, event: OrderEvent) -> None:
    if isinstance(event, OrderCreated):
        day = event.order[2:10]
        fleet.order_counts[day] = fleet.order_counts.get(day, 0) + 1
        fleet.orders[event.order] = order_created(event)
        return
    before = fleet.orders[event.order]
    after = order_after(before, event)
    if after.terminal:
        del fleet.orders[event.order]
    else:
        fleet.orders[event.order] = after
    evolve_carrier(fleet, before, after, event)
