"""What M4's questions are answered with, for the OpenAPI document (spec/m4.md §5, §6, §8).

Answers are not built from these models but from rows, which is faster; tests hold the two together.
Units: metres, radians, seconds; dates are epoch milliseconds.
"""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, create_model

from projections.fields import FIELDS, FieldType

_JSON_TYPES: dict[FieldType, Any] = {
    FieldType.TEXT: str,
    FieldType.INTEGER: int,
    FieldType.NUMBER: float,
    FieldType.BOOLEAN: bool,
    FieldType.DATE: int,
    FieldType.TEXTS: list[str],
}


class Answer(BaseModel):
    """Base: nothing that is not named here is ever answered."""

    model_config = ConfigDict(extra="forbid", protected_namespaces=())


_ORDER_FIELDS: dict[str, Any] = {
    field.name: (_JSON_TYPES[field.type] | None, Field(None, description=field.doc))
    for field in FIELDS
}
TransportOrder: type[Answer] = create_model(
    "TransportOrder",
    __base__=Answer,
    __doc__="A transport order without its steps. A projection leaves fields out.",
    **_ORDER_FIELDS,
)


class RejectReason(Answer):
    """Why something cannot be done now."""

    code: str = Field(description="Code of the refusal.", examples=["AllRobotUnDispatchable"])
    params: list[Any] = Field(description="Robot -> its own reason, one object for each robot.")


class OrderStep(Answer):
    """One step of an order."""

    id: str = Field(description="Step id.")
    orderId: str = Field(description="Order that it belongs to.")
    stepIndex: str = Field(description="Position in the order, from 0, as text (C3).")
    status: Literal["Executable", "Executing", "Done", "Skipped"] = Field(
        description="How far it is; Skipped is not used."
    )
    location: str = Field(description="Point or bin.")
    rbkArgs: str | None = Field(description="Action arguments: the text of a JSON object (C4).")
    forLoad: bool = Field(description="Pick up in this step.")
    forUnload: bool = Field(description="Put down in this step.")
    withdrawOrderAllowed: bool = Field(description="The order may go to another robot here.")
    nextStepSameOrder: bool = Field(description="The robot's next step must be of this order.")
    createdOn: int = Field(description="When it was created, epoch ms.")
    createdBy: str | None = Field(description="Null: the order says who.")
    modifiedOn: int = Field(description="When it last changed, epoch ms.")
    modifiedBy: str | None = Field(description="Null: the order says who.")
    startOn: int | None = Field(description="When its robot set out for it, epoch ms.")
    endOn: int | None = Field(description="When it was done, epoch ms.")
    processingTime: float = Field(description="From creation to the end, s; 0 before.")
    executingTime: float = Field(description="From start to end, s; 0 before.")
    version: int = Field(description="Counts its changes.")


OrderDetail: type[Answer] = create_model(
    "OrderDetail",
    __base__=TransportOrder,
    __doc__="A transport order with its steps, and why it waits.",
    allocationReject=(RejectReason | None, Field(None, description="Why it has no robot.")),
    executionReject=(RejectReason | None, Field(None, description="Why it does not get on.")),
    steps=(list[OrderStep], Field(description="Its steps, in order.")),
)


class FindPageResult(Answer):
    """One page of orders."""

    pageNo: int = Field(description="Page, from 1.")
    pageSize: int = Field(description="Rows of a page.")
    total: int = Field(description="Rows that match, on all pages.")
    page: list[TransportOrder] = Field(description="Rows of this page.")


class FindOneResult(Answer):
    """One order, or null."""

    entityValue: TransportOrder | None = Field(description="The order; null if there is none.")


class FindCountResult(Answer):
    """How many."""

    count: int = Field(description="Orders that match.")


class PointXY(Answer):
    """A place (spec/m4.md, Point2D)."""

    x: float = Field(description="m")
    y: float = Field(description="m")


class CollisionPolygon(Answer):
    """The robot's outline in its own coordinates."""

    points: list[PointXY] = Field(description="Corners.")
    type: Literal["Other", "Rect"] = Field(description="Kind of polygon.")
    ignoreRobotSafeDist: bool | None = Field(description="Always null.")
    ignoreLoadSafeDist: bool | None = Field(description="Always null.")
    empty: bool = Field(description="It has no corners.")


class SpaceResource(Answer):
    """Ground that a robot holds."""

    type: Literal["Rect", "Circle", "Polygon"] = Field(description="Kind of shape.")
    points: list[PointXY] = Field(description="Corners; of a circle its centre.")
    radius: float | None = Field(description="Of a circle, m.")


class RobotAlarm(Answer):
    """Trouble that the robot reports itself, or that traffic has with it."""

    level: Literal["Info", "Warning", "Error", "Fatal"] = Field(description="How bad.")
    code: str = Field(description="Code of the robot; TrafficStuck = it cannot get on.")
    message: str = Field(description="In words.")
    times: int = Field(description="How often so far.")
    timestamp: int = Field(description="When, epoch ms.")


class RobotLoadRelation(Answer):
    """What lies on the robot."""

    type: str = Field(description="Kind of goods.")
    id: str = Field(description="Container.")
    points: list[PointXY] = Field(description="Outline, in the robot's coordinates.")
    direction: float = Field(description="rad")


class RobotBin(Answer):
    """A storage place of the robot."""

    index: int = Field(description="From 0.")
    status: Literal["Empty", "Reserved", "Filled", "Cancelled"] = Field(
        description="Cancelled: its order was cancelled with the load on board."
    )
    orderId: str | None = Field(None, description="Order that has it; absent if none.")
    containerId: str | None = Field(None, description="Container in it; absent if none.")


class UiRobotReport(Answer):
    """A robot at one moment. What has no value is absent; lists are there although empty."""

    name: str = Field(description="Robot name.")
    offDuty: bool = Field(description="Takes no orders.")
    online: bool = Field(description="Answers.")
    connectMsg: str | None = Field(None, description="Why it is not connected (C7).")
    rTime: int | None = Field(None, description="The moment, epoch ms: one for all robots.")
    x: float | None = Field(None, description="m")
    y: float | None = Field(None, description="m")
    d: float | None = Field(None, description="Heading, rad.")
    p: str | None = Field(None, description="Point it stands on.")
    bp: str | None = Field(None, description="Point from which it is planned.")
    v: float | None = Field(None, description="Speed, m/s; negative = backwards.")
    rv: float | None = Field(None, description="Speed of rotation, rad/s.")
    areaId: int | None = Field(None, description="Area it is in.")
    map: str | None = Field(None, description="Name of its map.")
    mapMd5: str | None = Field(None, description="MD5 of its map (C7).")
    cff: bool = Field(description="Controlled by the dispatcher, or by nobody.")
    controller: str | None = Field(None, description="Who holds control.")
    emc: bool = Field(description="Emergency stop.")
    sEmc: bool = Field(description="Soft emergency stop.")
    blocked: bool = Field(description="Blocked, as it says itself.")
    blockedMsg: int | None = Field(None, description="Code of blockedReason (spec/m4.md §8).")
    alarms: list[RobotAlarm] = Field(description="Its own alarms, and traffic's.")
    collision: CollisionPolygon = Field(description="Its outline.")
    loads: list[RobotLoadRelation] | None = Field(None, description="What lies on it.")
    battery: float | None = Field(None, description="0 to 1.")
    charging: bool = Field(description="Battery rises.")
    c: float | None = Field(None, description="Confidence of its position, 0 to 1.")
    reloc: Literal["Init", "Success", "Relocing", "Loading"] = Field(
        description="How finding its position stands."
    )
    to: float | None = Field(None, description="Driven today, m.")
    navId: str | None = Field(None, description="Move that it drives.")
    navStatus: int | None = Field(None, description="2 = running.")
    bins: list[RobotBin] = Field(description="Its storage places.")
    noAc: bool = Field(description="Nobody tries to reach it any more until asked to.")
    cmdStatus: Literal["Idle", "Moving", "Failed"] = Field(description="How its orders get on.")
    oFaultMsg: str | None = Field(None, description="Why its order is faulted.")
    withBzOrder: bool = Field(description="Has a business order.")
    autoOrder: str | None = Field(None, description="Order of the system's own that it has.")
    orders: list[str] = Field(description="Its orders, first assigned first.")
    cuOrderId: str | None = Field(None, description="Order that it is at.")
    cuStepIndex: int | None = Field(None, description="Step that it is at, from 0.")
    cuStepLocation: str | None = Field(None, description="Where that step is done.")
    op: str | None = Field(None, description="Action of that step.")
    targetPoint: str | None = Field(None, description="Point that it drives to.")
    unTravelled: list[str] = Field(description="Paths still to be driven.")
    spaces: list[SpaceResource] = Field(description="Ground that it holds.")
    tReady: bool = Field(description="Traffic knows where it is and may move it.")
    ttId: str | None = Field(None, description="Traffic task.")
    ttStatus: Literal["Created", "TrafficAccepted", "Success", "Failed", "Cancelled"] | None = (
        Field(None, description="How it stands.")
    )
    bbr: list[str] = Field(description="Who blocks it.")
    ka: bool = Field(description="An action is under way.")
    disabled: bool = Field(description="Taken out of dispatch.")
    mock: bool = Field(description="Simulated.")
    raw: dict[str, Any] | None = Field(None, description="Its own report (Robokit 1100), if asked.")


class RobotPoint(Answer):
    """Where a robot is."""

    pointName: str | None = Field(description="Point it stands on; null between points.")
    direction: float = Field(description="Heading, rad.")
    x: float = Field(description="m")
    y: float = Field(description="m")


class RobotMapNameMd5(Answer):
    """A map that a robot may use."""

    mapName: str = Field(description="Name of the map.")
    mapMd5: str = Field(description="MD5 of the map.")
    current: bool = Field(description="The robot uses it now.")
