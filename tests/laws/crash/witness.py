"""What the outside was told, and what must be true because of it.

A model in dictionaries that shares no code with the ledger: it reads the segments with the stock
MCAP reader, and events as plain JSON.
"""

import json
from collections import defaultdict
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

from mcap.records import Message
from mcap.stream_reader import StreamReader

from commands.orders import CreateOrder
from ledger.ids import OrderId
from tests.laws.crash.clients import Request

Json = dict[str, Any]
Reply = tuple[int, str]  # status, body

ENDS = ("OrderFinished", "OrderCancelled")


def history(folder: Path) -> list[Json]:
    """All events of a ledger whose segments are finished."""
    events: list[Json] = []
    for path in sorted(folder.glob("*.mcap")):
        events += _segment(path.read_bytes())
    return events


@lru_cache(maxsize=256)  # most are as they were when we last looked
def _segment(data: bytes) -> list[Json]:
    records = StreamReader(BytesIO(data), validate_crcs=True).records
    return [json.loads(record.data) for record in records if isinstance(record, Message)]


class Orders:
    """A fold of its own over orders, by id: priority, number of steps, sealed; None = ended."""

    def __init__(self) -> None:
        self.by_id: dict[str, tuple[int, int, bool] | None] = {}
        self.ended: dict[str, int] = {}  # position

    def take(self, event: Json) -> None:
        kind, id_ = event["type"], event.get("order")
        if kind == "OrderCreated":
            assert id_ not in self.by_id, f"{id_} was made twice"
            self.by_id[id_] = (event["priority"], len(event["tasks"]), event["sealed"])
            return
        if id_ is None or kind.startswith("MapResources"):
            return
        now = self.by_id[id_]
        assert now is not None, f"{kind} at {event['position']}, but {id_} has ended"
        priority, steps, sealed = now
        if kind == "StepsAdded":
            self.by_id[id_] = (priority, steps + len(event["tasks"]), sealed)
        elif kind == "OrderSealed":
            self.by_id[id_] = (priority, steps, True)
        elif kind == "OrderPrioritised":
            self.by_id[id_] = (event["priority"], steps, sealed)
        elif kind in ENDS:
            self.by_id[id_] = None
            self.ended[id_] = event["position"]


class Witness:
    """Remembers what was said and shown; complains where the history denies it."""

    def __init__(self) -> None:
        self.asked: dict[str, Request] = {}
        self.replies: dict[str, Reply] = {}  # the first one given to each key
        self.made: list[OrderId] = []  # orders that clients know of
        self.shown: list[Json] = []  # events that a follower saw, from position 1
        self.orders = Orders()

    def follow(self, key: str, payload: bytes) -> None:
        """Hear what the core publishes; the stream must go on where it was."""
        del key
        for event in json.loads(payload)["events"]:
            position = event["position"]
            assert position <= len(self.shown) + 1, f"{position} after {len(self.shown)}"
            if position <= len(self.shown):
                assert self.shown[position - 1] == event, f"{position} was told otherwise"
            else:
                self.shown.append(event)

    def acknowledge(self, request: Request, reply: Reply) -> None:
        """Hear an answer; to a repeated key it is the first one, to the byte."""
        first = self.replies.setdefault(request.key, reply)
        if first is reply and reply[0] == 200 and request.kind is CreateOrder:
            self.made.append(OrderId(json.loads(reply[1])["made"]))
        assert reply == first, f"{request.key} was answered {first}, and now {reply}"

    def check(self, folder: Path) -> None:
        """Hold a history to all that was said; afterwards it counts as shown."""
        events = history(folder)
        assert len(events) >= len(self.shown), f"{len(events)} of {len(self.shown)} events are left"
        for position, event in enumerate(events, 1):
            assert event["position"] == position, f"{event['position']} stands at {position}"
        for event, shown in zip(events, self.shown, strict=False):
            assert event == shown, f"{event} was shown as {shown}"
        times = [event["at_ms"] for event in events]
        assert times == sorted(times), "time went back"
        self._check_commands(events)
        self.shown = events

    def _check_commands(self, events: list[Json]) -> None:
        self.orders = Orders()
        by_command: dict[str, list[Json]] = defaultdict(list)
        answered: dict[str, Reply] = {}
        for event in events:
            self.orders.take(event)
            key = event["command"]
            if key not in self.asked:
                continue
            assert key not in answered, f"{event['type']} after the answer to {key}"
            if event["type"] != "CommandAnswered":
                by_command[key].append(event)
                continue
            answered[key] = (event["status"], event["body"])
            self._check_effect(self.asked[key], answered[key], by_command[key])
        lost = self.replies.keys() - answered.keys()
        assert not lost, f"acknowledged and lost: {sorted(lost)}"
        for key, reply in self.replies.items():
            assert answered[key] == reply, f"{key} was answered {reply}, not {answered[key]}"
        halves = by_command.keys() - answered.keys()
        assert not halves, f"without an answer beside them: {sorted(halves)}"

    def _check_effect(self, request: Request, reply: Reply, events: list[Json]) -> None:
        """What the answer says has happened, once, and is so right after it."""
        status, body = reply
        kinds = [event["type"] for event in events]
        if status != 200:
            assert kinds == [], f"{request.key} was refused, but {kinds}"
            return
        whose = [(e["type"], e.get("order"), e.get("robot")) for e in events]
        assert len(set(whose)) == len(whose), f"{request.key} did something twice: {whose}"
        orders, fields = self.orders.by_id, request.fields
        match request.kind.__name__:
            case "CreateOrder":
                assert kinds == ["OrderCreated"]
                wanted = (fields.get("priority", 0), len(fields.get("tasks", ())), fields["sealed"])
                assert orders[json.loads(body)["made"]] == wanted
            case "AddSteps":
                assert kinds == ["StepsAdded"]
                assert len(events[0]["tasks"]) == len(fields["tasks"])
            case "CancelOrder":
                assert orders[fields["order"]] is None
            case "SealOrder":
                now = orders[fields["order"]]
                assert now is None or now[2]
            case "PrioritiseOrders" if not json.loads(body)["refused"]:
                for order in fields["orders"]:
                    now = orders[order]
                    assert now is None or now[0] == fields["priority"]
