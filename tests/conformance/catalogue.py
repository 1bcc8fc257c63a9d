"""The catalogue of the specification, which lies beside the repository and may be missing."""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import yaml

CATALOGUE = Path(__file__).resolve().parents[2] / "../shared/spec/catalogue.yaml"
DIALECT = "m4"
PLAIN = frozenset(
    {"String", "Boolean", "Int", "Long", "Double", "Date", "Object", "Any", "EntityValue"}
)
# named in the source and described nowhere (spec/m4.md §8)
UNDESCRIBED = frozenset(
    {"StepExecuteDigest", "TrafficTaskRuntime", "NavTaskRuntime", "MoveActionRuntime"}
    | {"DispatchProfile"}
)
# the source lists these among its types, and no call of it answers them (spec/m4.md §8)
NEVER_ANSWERED = frozenset(
    {"RobotUiReport", "RobotSelfReport", "RobotSelfReportMain", "RobotSelfBin", "RobotStand"}
    | {"PathPosition", "RobotOrderUiReport"}
)
ASKED_ONLY = frozenset(
    {"CreateStepReq", "UpdateStepReq", "MapResourceUnit", "ComplexQuery", "SceneRobot"}
    | {"SceneRobotDefaultNull"}
)
# optional, in no example (C18)
LEFT_OUT = frozenset({"OrderStep.percentage", "TransportOrder.noLoad", "OrderDetail.noLoad"})

_GENERIC = re.compile(r"(List|Set|Map)<(?:(\w+), )?(.+)>")


class Field(msgspec.Struct, frozen=True, kw_only=True):
    """One row of a table: where it stands, what it is."""

    name: str
    where: str  # path, query, body or content; empty in types
    type: str
    required: bool
    default: Any = None


class Call(msgspec.Struct, frozen=True, kw_only=True):
    """One call."""

    id: str
    title: str
    method: str
    path: str
    request: tuple[Field, ...]
    response: tuple[Field, ...]  # where the catalogue lists them in place
    response_type: str | None


class Catalogue(msgspec.Struct, frozen=True, kw_only=True):
    """All of the dialect."""

    calls: tuple[Call, ...]
    types: dict[str, tuple[Field, ...]]
    enums: dict[str, tuple[str, ...]]

    def fields_of(self, type_: str) -> tuple[Field, ...]:
        """Fields of a type or of what a list or map holds; none of plain types."""
        name = element(type_).removesuffix("<Object>")  # ParallelResult<Object>
        if name == "OrderDetail":  # "extends TransportOrder"
            return (*self.types["TransportOrder"], *self.types[name])
        return self.types.get(name, ())


def there() -> bool:
    """Tell whether the specification is beside the repository."""
    return CATALOGUE.is_file()


@cache
def catalogue() -> Catalogue:
    """Read it; empty where it is missing, so that tests over it are not even collected."""
    if not there():
        return Catalogue(calls=(), types={}, enums={})
    raw = yaml.safe_load(CATALOGUE.read_text())
    return Catalogue(
        calls=tuple(_call(c) for c in raw["endpoints"] if c["dialect"] == DIALECT),
        types={name: _fields(fields) for name, fields in raw["types"][DIALECT].items()},
        enums={name: tuple(values) for name, values in raw["enums"][DIALECT].items()},
    )


def _call(raw: dict[str, Any]) -> Call:
    return Call(
        id=raw["id"],
        title=raw["title"],
        method=raw["method"],
        path=raw["path"],
        request=_fields(raw.get("request") or ()),
        response=_fields(raw.get("response") or ()),
        response_type=raw.get("response_type"),
    )


def _fields(raw: Any) -> tuple[Field, ...]:
    return tuple(
        Field(
            name=f["name"],
            where=f.get("in", ""),
            type=f["type"],
            required=f.get("required") is True,
            default=f.get("default"),
        )
        for f in raw
    )


def element(type_: str) -> str:
    """Name what a list, set or map holds, at any depth; the type itself if it is none."""
    while (found := _GENERIC.fullmatch(type_)) is not None:
        type_ = found[3]
    return type_


def container(type_: str) -> str | None:
    """Tell a list (or set) from a map; None for anything else."""
    found = _GENERIC.fullmatch(type_)
    return None if found is None else {"Map": "map"}.get(found[1], "list")


class Place(msgspec.Struct, frozen=True, kw_only=True):
    """A field within a body, however deep: the names on the way to it."""

    call: Call
    field: Field
    path: tuple[str, ...]  # names, and "[]" for the elements of a list or map

    @property
    def name(self) -> str:
        """Spell it `orders-create.steps[].location`."""
        text = "".join(part if part == "[]" else f".{part}" for part in self.path)
        return f"{self.call.id}{text}"


def request_places() -> Iterator[Place]:
    """Every field that a client can send, nested ones included; not those of ComplexQuery."""
    for call in catalogue().calls:
        yield from _places(call, call.request, ())


def response_places() -> Iterator[Place]:
    """Every field that a client can be answered."""
    for call in catalogue().calls:
        if call.response:
            yield from _places(call, call.response, ())
        elif call.response_type is not None:
            start = ("[]",) if container(call.response_type) else ()
            yield from _places(call, catalogue().fields_of(call.response_type), start)


def _places(call: Call, fields: tuple[Field, ...], before: tuple[str, ...]) -> Iterator[Place]:
    for field in fields:
        path = before if field.name == "(body)" else (*before, field.name)
        if field.name == "(body)" and container(field.type):
            path = (*path, "[]")
        elif container(field.type):
            yield Place(call=call, field=field, path=path)
            path = (*path, "[]")
        elif field.name != "(body)":
            yield Place(call=call, field=field, path=path)
        inner = catalogue().fields_of(field.type)
        if field.type == "List<EntityValue>":  # business objects, named by their field
            inner = catalogue().types["OrderStep" if field.name == "steps" else "TransportOrder"]
        if element(field.type) != "ComplexQuery":
            yield from _places(call, inner, path)
