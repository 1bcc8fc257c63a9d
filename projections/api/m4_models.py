"""What M4 clients send to the read side. Fields that we do not know are left alone."""

from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, RootModel, StringConstraints
from pydantic.config import JsonDict

PAGE_SIZE_MAX = 10_000
FUZZY_LENGTH_MAX = 200
NAMES_MAX = 100
NAME_CHARS_MAX = 200
ROBOTS_MAX = 1_000  # in one question about move costs
PLACES_MAX = 10_000  # of one robot
BATCH_MAX = 20  # questions of one find/batch
QUERY_EXAMPLE: JsonDict = {
    "type": "Compound",
    "items": [
        {"type": "General", "field1": "stepFixed", "operator": "Eq", "value": "true"},
        {"type": "General", "field1": "status", "operator": "Eq", "value": "Done"},
    ],
}


Name = Annotated[str, StringConstraints(min_length=1, max_length=NAME_CHARS_MAX)]


class Asking(BaseModel):
    """Base: strict types, camel-case names."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True, populate_by_name=True)


class AsOf(BaseModel):
    """The query part that every question takes."""

    model_config = ConfigDict(extra="ignore", frozen=True, populate_by_name=True)

    as_of: str | None = Field(
        None, alias="asOf", description="A past moment: epoch milliseconds or ISO 8601."
    )


class CountAsked(Asking):
    """find/count."""

    entity_name: str = Field(alias="entityName", description="TransportOrder.")
    query: Any = Field(
        None,
        description="ComplexQuery; null = all.",
        json_schema_extra={"type": ["object", "null"], "examples": [QUERY_EXAMPLE]},
    )
    fuzzy: str | None = Field(
        None, max_length=FUZZY_LENGTH_MAX, description="Part of the order id, in any case."
    )
    as_of: int | str | None = Field(None, alias="asOf", description="A past moment; null = now.")


class RowsAsked(CountAsked):
    """What find/many, find/page and find/one share."""

    projection: list[str] | None = Field(
        None, max_length=NAMES_MAX, description="Fields to answer; null = all."
    )
    sort: list[str] | None = Field(None, description="Fields; `-` in front = descending.")


class ManyAsked(RowsAsked):
    """find/many."""

    skip: int | None = Field(None, description="Rows to leave out at the front.")
    limit: int | None = Field(None, description="Rows at most; null or negative = all.")


class PageAsked(RowsAsked):
    """find/page."""

    page_no: int = Field(alias="pageNo", ge=1, le=1_000_000_000, description="From 1.")
    page_size: int = Field(alias="pageSize", ge=1, le=PAGE_SIZE_MAX, description="Rows of a page.")


class OneAsked(RowsAsked):
    """find/one: by id, or the first that meets the query."""

    id: str | None = Field(None, description="Order id; goes before the query.")
    skip: int | None = Field(None, description="Rows to leave out at the front.")


class DetailAsked(AsOf):
    """orders/query-order-detail."""

    order_id: str = Field(alias="orderId", min_length=1, max_length=200, description="Order id.")


class RobotsAsked(AsOf):
    """robots/all-all."""

    scene_id: str | None = Field(None, alias="sceneId", description="Goes before sceneName.")
    scene_name: str | None = Field(
        None, alias="sceneName", description="Name of a scene, where no id is given."
    )
    raw_all: bool = Field(False, alias="rawAll", description="With the robots' own reports.")


class RobotAsked(AsOf):
    """robots/query-point."""

    scene_id: Name = Field(alias="sceneId", description="Id of the scene.")
    robot_name: Name = Field(alias="robotName", description="Name of the robot.")


class Entry(Asking):
    """One question of a find/batch."""

    type: Literal["One", "Many", "Page"] = Field(description="Which of find/one, many and page.")
    req: dict[str, Any] = Field(description="Its body.")


class OrderQueryType(StrEnum):
    """Which orders a scene query shows (spec/m4.md, OrderQueryType)."""

    ALL = "AllOrders"
    UNFINISHED = "NoFinishedOrders"
    FAULTED = "FaultOrders"


class SceneDataAsked(Asking):
    """What the scene query takes, beside the scene; all of it may be left out."""

    excluded: Annotated[list[str], Field(max_length=NAMES_MAX)] | None = Field(
        None,
        description="Properties of the reply not wanted; `traffic` stands for `trafficConditions` "
        "and the robots' `unTravelled` and `spaces`. Others than these are ignored.",
    )
    with_raw: bool | None = Field(
        None, alias="withRawReport", description="With the robots' own reports. Deprecated."
    )
    raw_all: bool | None = Field(None, alias="rawAll", description="With the robots' own reports.")
    raw_fields: Annotated[list[str], Field(max_length=NAMES_MAX)] | None = Field(
        None, alias="rawFields", description="Which fields of the robots' own reports; null = all."
    )
    order_query_type: OrderQueryType | None = Field(
        None,
        alias="orderQueryType",
        description="Which orders: AllOrders (also if left out), NoFinishedOrders, FaultOrders.",
    )
    as_of: int | str | None = Field(None, alias="asOf", description="A past moment; null = now.")


class SceneAsked(SceneDataAsked):
    """The scene query over WebSocket, where no URL names the scene."""

    scene_id: Name = Field(alias="sceneId", description="Id of the scene.")


class ReportsAsked(Asking):
    """All robots over WebSocket."""

    scene_id: Name = Field(alias="sceneId", description="Id of the scene.")
    as_of: int | str | None = Field(None, alias="asOf", description="A past moment; null = now.")


class OrderAsked(Asking):
    """The detail of an order over WebSocket."""

    order_id: Name = Field(alias="orderId", description="Id of the order.")
    as_of: int | str | None = Field(None, alias="asOf", description="A past moment; null = now.")


class MoveCostsAsked(RootModel[dict[Name, Annotated[list[Name], Field(max_length=PLACES_MAX)]]]):
    """Robots of the scene, and the points and bins to which their ways are asked for."""

    root: Annotated[
        dict[Name, Annotated[list[Name], Field(max_length=PLACES_MAX)]],
        Field(max_length=ROBOTS_MAX, description="Robot -> names of points and bins."),
    ]


class StreamAsked(Asking):
    """Which scene to follow, and what of it."""

    scene_id: Name = Field(alias="sceneId", description="Id of the scene.")
    fields: Annotated[list[str], Field(max_length=NAMES_MAX)] | None = Field(
        None, description="Properties of the scene query wanted; null = those that change."
    )
