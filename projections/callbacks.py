"""Which callbacks an event leads to: what is told to whom when an order's state changes."""

import hashlib

import msgspec

from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.events import (
    AnyEvent,
    CallbacksConfigured,
    OrderCancelled,
    OrderCreated,
    OrderEvent,
    OrderWithdrawn,
    SceneImported,
    SceneRenamed,
)
from ledger.events.orders import OfOrder
from ledger.evolve_order import order_after, order_created
from ledger.ids import OrderId, RobotName, SceneId
from ledger.scene import Value
from ledger.state import Fleet, Order, OrderKind

ID_CHARS = 32


class Callback(Value, frozen=True, kw_only=True):
    """One message that one address must get; all that is needed to send it, also after a crash."""

    number: int = 0  # in the order in which they came up, from 1; 0 = not kept yet
    id: str  # the same for every try, and for every server that reads this ledger
    scene: SceneId
    url: str
    order: OrderId
    status: CallbackStatus
    position: int  # of the event that it tells of
    at_ms: int  # when that happened
    retries_max: int
    retry_s: float
    body: bytes  # JSON, as it is sent
    tries: int = 0  # that failed
    error: str = ""  # what the last try met


class OrderCallback(msgspec.Struct, frozen=True, kw_only=True):
    """The body of a callback (docs/callbacks.md); names as clients of M4 know them."""

    id: str
    type: str = "OrderStatus"
    sceneId: SceneId
    sceneName: str
    orderId: OrderId
    externalId: str | None
    status: CallbackStatus
    previousStatus: CallbackStatus | None  # None: the order is new
    robotName: RobotName | None  # who has the order; on Withdrawing, who loses it
    at: int  # epoch ms, when it happened
    position: int


class Change(Value, frozen=True, kw_only=True):
    """An order went from one state to the next."""

    status: CallbackStatus
    previous: CallbackStatus | None
    robot: RobotName | None


def changes(
    event: OrderEvent, was: CallbackStatus | None, before: Order | None, after: Order
) -> tuple[Change, ...]:
    """Give the changes of state that an event means, those on the way included, in order.

    `was` is the state told of last; None where the order is new. A sealed order is never Pending
    for anybody outside: the decision that ends its last step ends the order too.
    """
    now = CallbackStatus(after.status)
    between = None
    if isinstance(event, OrderWithdrawn):
        between = CallbackStatus.WITHDRAWING
    elif isinstance(event, OrderCancelled):
        between = CallbackStatus.CANCELLING
    if between is not None and before is not None:
        return (
            Change(status=between, previous=was, robot=before.robot),
            Change(status=now, previous=between, robot=after.robot),
        )
    if now is was or (now is CallbackStatus.PENDING and after.sealed):
        return ()
    return (Change(status=now, previous=was, robot=after.robot),)


class Telling:
    """A fold over the business orders of all scenes, and over who wants to hear of them.

    Orders that the system makes for itself, to park, to charge, to make room, are told to nobody.
    The settings count as they were when the event happened.
    """

    def __init__(self, fleet: Fleet) -> None:
        """Take the state to go on from; it is not changed."""
        self.position = fleet.position
        self._orders = {
            id_: order for id_, order in fleet.orders.items() if order.kind is OrderKind.BUSINESS
        }
        self._told = {id_: CallbackStatus(order.status) for id_, order in self._orders.items()}
        self._names = {id_: scene.name for id_, scene in fleet.scenes.items()}
        self._configs = {
            id_: scene.callbacks for id_, scene in fleet.scenes.items() if scene.callbacks.enabled
        }

    @property
    def wanted(self) -> bool:
        """Tell whether anybody wants to hear anything."""
        return bool(self._configs)

    def take(self, event: AnyEvent) -> tuple[Callback, ...]:
        """Take in the next event; gives what is to be told because of it."""
        assert event.position == self.position + 1, f"{event.position} after {self.position}"
        self.position = event.position
        match event:
            case OrderCreated():
                if event.kind is not OrderKind.BUSINESS:
                    return ()
                return self._changed(event, None, order_created(event))
            case OfOrder():
                before = self._orders.get(event.order)
                if before is not None:  # else it is one of the system's own
                    return self._changed(event, before, order_after(before, event))
            case CallbacksConfigured(scene=scene, callbacks=config):
                self._configs.pop(scene, None)
                if config.enabled:
                    self._configs[scene] = config
            case SceneImported() | SceneRenamed():
                self._names[event.scene] = event.name
            case _:
                pass  # of no order and no setting
        return ()

    def _changed(
        self, event: OrderEvent, before: Order | None, after: Order
    ) -> tuple[Callback, ...]:
        changed = changes(event, self._told.get(after.id), before, after)
        if after.terminal:
            del self._orders[after.id], self._told[after.id]
        else:
            self._orders[after.id] = after
            if changed:
                self._told[after.id] = changed[-1].status
        config = self._configs.get(event.scene)
        if config is None:
            return ()
        return tuple(
            self._callback(event, after, change, config, url)
            for change in changed
            if not config.statuses or change.status in config.statuses
            for url in config.urls
        )

    def _callback(
        self, event: OrderEvent, order: Order, change: Change, config: CallbackConfig, url: str
    ) -> Callback:
        id_ = callback_id(event, change.status, url)
        body = OrderCallback(
            id=id_,
            sceneId=event.scene,
            sceneName=self._names[event.scene],
            orderId=order.id,
            externalId=order.external_id,
            status=change.status,
            previousStatus=change.previous,
            robotName=change.robot,
            at=event.at_ms,
            position=event.position,
        )
        return Callback(
            id=id_,
            scene=event.scene,
            url=url,
            order=order.id,
            status=change.status,
            position=event.position,
            at_ms=event.at_ms,
            retries_max=config.retries_max,
            retry_s=config.retry_s,
            body=msgspec.json.encode(body),
        )


def callback_id(event: OrderEvent, status: CallbackStatus, url: str) -> str:
    """Make the id by which a receiver knows a repetition.

    From what happened alone, so that a callback found again after a crash has the same id; time
    and order are in it because positions come again where a backup was restored.
    """
    parts = (event.scene, event.order, status, event.position, event.at_ms, url)
    return hashlib.sha256(msgspec.json.encode(parts)).hexdigest()[:ID_CHARS]
