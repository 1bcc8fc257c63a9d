"""Holds answers to the catalogue: no other key, the right types; and notes what has been seen."""

from typing import Any

from tests.conformance.catalogue import UNDESCRIBED, catalogue, container, element

# readings of spec/m4.md §9 where a table and the examples disagree, and keys of examples only
READ_AS = {
    "UiRobotReport.connectMsg": "String",  # C7
    "UiRobotReport.mapMd5": "String",  # C7
    "OrderStep.stepIndex": "String",  # C3
    "ParallelResult.result": "Object",  # C8
}
ONLY_IN_EXAMPLES = {
    "UiRobotReport": {"disabled": "Boolean", "mock": "Boolean", "bp": "String", "ka": "Boolean"},
    "Polygon": {  # C5: of the collision model
        "ignoreRobotSafeDist": "Boolean",
        "ignoreLoadSafeDist": "Boolean",
        "empty": "Boolean",
    },
}
PLAIN: dict[str, type | tuple[type, ...]] = {
    "String": str,
    "Boolean": bool,
    "Int": int,
    "Long": int,
    "Date": int,
    "Double": (int, float),
}


def conforms(value: Any, type_: str, where: str, seen: set[str]) -> None:
    """Check a value against its type, all the way down; null fits anything."""
    if value is None:
        return
    if container(type_) is not None:
        assert isinstance(value, dict if container(type_) == "map" else list), f"{where}: {value!r}"
        inner = type_[type_.index("<") + 1 : -1]
        inner = inner.partition(", ")[2] if container(type_) == "map" else inner
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            conforms(item, inner, f"{where}[{key}]", seen)
    elif type_ in PLAIN:
        right = isinstance(value, PLAIN[type_]) and isinstance(value, bool) is (type_ == "Boolean")
        assert right, f"{where} is a {type_}, not {value!r}"
    elif type_ in catalogue().enums:
        assert value in catalogue().enums[type_], f"{where}: {value!r} is no {type_}"
    elif fields := catalogue().fields_of(type_):
        name = element(type_).removesuffix("<Object>")
        known = {field.name: field.type for field in fields} | ONLY_IN_EXAMPLES.get(name, {})
        assert value.keys() <= known.keys(), f"{where}: {value.keys() - known.keys()} is not known"
        for key, item in value.items():
            _member(item, name, key, known[key], where, seen)
    else:
        assert type_ in {"Object", "Any", "EntityValue"} | UNDESCRIBED, f"{where}: {type_}?"


def _member(value: Any, owner: str, key: str, type_: str, where: str, seen: set[str]) -> None:
    if type_ == "List<EntityValue>":
        type_ = "List<OrderStep>" if key == "steps" else "List<TransportOrder>"
    seen.add(f"{owner}.{key}")
    conforms(value, READ_AS.get(f"{owner}.{key}", type_), f"{where}.{key}", seen)
