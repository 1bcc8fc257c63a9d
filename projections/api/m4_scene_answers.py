"""What a scene query is answered with, for the OpenAPI document (spec/m4.md §6)."""

from typing import Any, Literal

from pydantic import Field

from projections.api.m4_answers import Answer, RejectReason, TransportOrder, UiRobotReport

Door = Literal["Unknown", "Closed", "Closing", "Opening", "Opened"]


class OrderRuntimeRecord(Answer):
    """How an unfinished order gets on."""

    orderId: str = Field(description="Order id.")
    status: Literal["ToBeAllocated", "Allocated", "Pending", "Executing"] = Field(
        description="OrderStatus; finished orders have no record."
    )
    allocationReject: RejectReason | None = Field(description="Why it has no robot.")
    executionReject: RejectReason | None = Field(description="Why it does not get on.")
    createdOn: int = Field(description="When it was created, epoch ms.")


class UiDoorReport(Answer):
    """A door at one moment."""

    id: int = Field(description="Door id.")
    name: str = Field(description="Name.")
    disabled: bool = Field(description="Out of service: nobody passes.")
    online: bool = Field(description="It reports.")
    uTime: int | None = Field(None, description="When it last reported, epoch ms.")
    status: Door = Field(description="DoorMainStatus.")
    fault: bool = Field(description="It does not work.")
    faultMsg: str | None = Field(None, description="Why not.")
    openRobots: list[str] = Field(description="Robots for which it is open or being opened.")


class UiLiftReport(Answer):
    """A lift at one moment."""

    id: int = Field(description="Lift id.")
    name: str = Field(description="Name.")
    disabled: bool = Field(description="Out of service.")
    online: bool = Field(description="It reports.")
    uTime: int | None = Field(None, description="When it last reported, epoch ms.")
    auto: bool | None = Field(None, description="It obeys; not driven by hand.")
    cf: str | None = Field(None, description="Floor that it is at, or was last.")
    tf: str | None = Field(None, description="Floor that it goes to.")
    doors: list[Door] = Field(description="State of its doors.")
    people: bool | None = Field(None, description="People are in it.")
    fault: bool = Field(description="It does not work.")
    faultMsg: str | None = Field(None, description="Why not.")


class FleetBin(Answer):
    """A place for a container on the map."""

    binName: str = Field(description="Name.")
    areaId: int = Field(description="Area that it is in.")
    occupied: bool | None = Field(description="Null: no stock is kept.")
    container: dict[str, Any] | None = Field(description="Null: no stock is kept.")


class SceneReply(Answer):
    """All that moves in a scene; what is excluded is absent."""

    status: Literal["Disabled", "Initializing", "Initialized", "Disposed"] | None = Field(
        None, description="Initializing until traffic has spoken of a robot that answers."
    )
    robots: dict[str, UiRobotReport] | None = Field(None, description="By name.")
    orders: list[TransportOrder] | None = Field(
        None,
        description="By the query type: the newest 5000 unfinished, then the newest 1000 ended.",
    )
    goingCount: int | None = Field(None, description="Orders being executed.")
    faultCount: int | None = Field(None, description="Unfinished orders that are faulted.")
    ordersRecords: dict[str, OrderRuntimeRecord] | None = Field(
        None, description="Unfinished orders by id, the newest 5000."
    )
    dispatchProfile: dict[str, int] | None = Field(
        None, description="Number of unfinished orders by status."
    )
    trafficDebug: dict[str, Any] | None = Field(
        None,
        description="Number of robots that traffic may move, moves, and holds back; and in `waits` "
        "who waits for whom, since when and why.",
    )
    sceneConfig: dict[str, Any] | None = Field(None, description="SceneConfig.")
    trafficConditions: dict[str, int] | None = Field(
        None, description="Path key -> robots on it or before it; paths without any are absent."
    )
    keepOrderNum: int | None = Field(None, description="0: no orders are made at random.")
    randomOrdersOn: bool | None = Field(None, description="False: none are made at random.")
    replayOrdersStop: bool | None = Field(None, description="True: none are replayed.")
    doors: dict[str, UiDoorReport] | None = Field(None, description="By id.")
    lifts: dict[str, UiLiftReport] | None = Field(None, description="By id.")
    pauseStatus: bool | None = Field(None, description="Dispatch is paused.")
    externalMapRes: Any = Field(None, description="Ground that others have reserved.")
    fleetBins: list[FleetBin] | None = Field(None, description="Places of areas in use.")
    replyTimestamp: int | None = Field(None, description="When it was answered, epoch ms.")


class SceneListed(Answer):
    """A scene in the list."""

    id: str = Field(description="Scene id.")
    name: str = Field(description="Name, unique among the scenes.")
    disabled: bool = Field(description="Out of service.")
    version: int = Field(description="Grows with every change of map, settings or state.")
    displayOrder: int = Field(description="Place in lists, ascending.")
    lastModifiedOn: int = Field(description="When it last changed, epoch ms.")


class SceneMap(Answer):
    """A scene as it is drawn; metres and radians, in the scene's frame."""

    id: str = Field(description="Scene id.")
    name: str = Field(description="Name.")
    version: str = Field(description="Digest of the content: the same map has the same.")
    areas: list[dict[str, Any]] = Field(
        description="id, name, disabled, map, mapMd5, bound {xMin, yMin, xMax, yMax}, points "
        "[{name, x, y, kind, direction}], paths [{key, start, end, controls, backward}], bins "
        "[{name, point, tasks}], walls [[[x, y], [x, y]]]."
    )
    groups: list[dict[str, Any]] = Field(
        description="id, name, footprint [[x, y]], footprintLoaded likewise, or null."
    )


class PointsAndBins(Answer):
    """The places of a scene."""

    points: list[str] = Field(description="Names of points.")
    bins: list[str] = Field(description="Names of bins.")


class SceneBasic(Answer):
    """What lists show of a scene."""

    name: str = Field(description="Name.")
    disabled: bool = Field(description="Out of service.")
    displayOrder: int = Field(description="Place in lists, ascending.")
    version: int = Field(description="Grows with every change.")
    lastModifiedOn: int = Field(description="When it last changed, epoch ms.")


class SceneStructure(Answer):
    """Of what a scene consists; lengths in metres, angles in radians."""

    robotGroups: list[dict[str, Any]] = Field(
        description="id, name, collisionModel, maxSpeed (m/s), maxAcc (m/s2), maxRotSpeed "
        "(rad/s), maxRotAcc (rad/s2)."
    )
    robotTags: list[str] = Field(description="Tags that robots have.")
    robots: list[dict[str, Any]] = Field(description="SceneRobot without its secret.")
    areas: list[dict[str, Any]] = Field(
        description="id, name, disabled, mergedMap {bound, points, paths, zones, topoAreas, bins, "
        "restrictedLines, sourceMaps}, gmMap (group -> map), groupsMap."
    )
    containerTypes: list[dict[str, Any]] = Field(description="name, collisionModel.")
    doors: list[dict[str, Any]] = Field(description="SceneDoor.")
    lifts: list[dict[str, Any]] = Field(description="SceneLift; costs in seconds.")


class SceneSchema(Answer):
    """How a scene is set up."""

    id: str = Field(description="Scene id.")
    basic: SceneBasic = Field(description="What lists show.")
    newConfig: dict[str, Any] = Field(description="SceneConfig, and parkIdleTime (s).")
    structure: SceneStructure = Field(description="Groups, robots, maps, devices.")
