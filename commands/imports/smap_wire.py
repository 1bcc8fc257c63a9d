"""The shape of a .smap file as it is written; only what we read of it."""

import base64
import binascii
import json

import msgspec

from ledger.errors import Refused
from ledger.scene import XY


class Wire(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """Base: keys are camelCase, and whatever is left out has its zero."""


class Position(Wire, frozen=True, kw_only=True):
    """A place on the map, metres."""

    x: float = 0.0
    y: float = 0.0

    @property
    def xy(self) -> XY:
        """As a pair."""
        return (self.x, self.y)


class Property(Wire, frozen=True, kw_only=True):
    """One of many optional settings; the value is in the field of its type, or base64 text."""

    key: str = ""
    type: str = ""
    value: str | None = None  # base64 of the text form, for old readers
    string_value: str | None = None
    bool_value: bool | None = None
    int32_value: int | None = None
    uint32_value: int | None = None
    int64_value: int | str | None = None  # proto3 writes 64-bit numbers as text
    uint64_value: int | str | None = None
    float_value: float | None = None
    double_value: float | None = None

    def read(self) -> str:
        """Text form of the value; empty if there is none."""
        for value in (
            self.string_value,
            self.bool_value,
            self.int32_value,
            self.uint32_value,
            self.int64_value,
            self.uint64_value,
            self.float_value,
            self.double_value,
        ):
            if value is not None:
                return value if isinstance(value, str) else json.dumps(value)
        try:
            return base64.b64decode(self.value or "", validate=True).decode()
        except (binascii.Error, UnicodeDecodeError):
            return ""


class Having(Wire, frozen=True, kw_only=True):
    """Base of all that has a class, a name and properties."""

    kind: str = msgspec.field(name="className", default="")
    name: str = msgspec.field(name="instanceName", default="")
    properties: list[Property] = msgspec.field(name="property", default_factory=list)

    def text(self, key: str) -> str | None:
        """Text of a property; None if it is not there."""
        return next((p.read() for p in self.properties if p.key == key), None)

    def flag(self, key: str, *, default: bool) -> bool:
        """Read a property as a truth value; one that is there without a value is false (proto3)."""
        text = self.text(key)
        return default if text is None else text.strip().lower() in ("true", "1")

    def number(self, where: str, key: str) -> float | None:
        """Read a property as a number; one that is there without a value is 0 (proto3)."""
        text = self.text(key)
        if text is None:
            return None
        try:
            return float(text or 0.0)
        except ValueError as error:
            what = f"{where}.property.{key}: not a number: {text!r}"
            raise Refused("BadSceneFile", what, text) from error


class PointMark(Having, frozen=True, kw_only=True):
    """A point."""

    pos: Position = Position()
    dir: float = 0.0  # rad
    ignore_dir: bool = False


class End(Wire, frozen=True, kw_only=True):
    """An end of a curve: a point by name, and where that is."""

    name: str = msgspec.field(name="instanceName", default="")
    pos: Position | None = None


class Curve(Having, frozen=True, kw_only=True):
    """A directed path."""

    start: End = msgspec.field(name="startPos", default=End())
    end: End = msgspec.field(name="endPos", default=End())
    control1: Position | None = msgspec.field(name="controlPos1", default=None)
    control2: Position | None = msgspec.field(name="controlPos2", default=None)


class Line(Wire, frozen=True, kw_only=True):
    """A straight wall."""

    start: Position = msgspec.field(name="startPos", default=Position())
    end: Position = msgspec.field(name="endPos", default=Position())


class NamedLine(Wire, frozen=True, kw_only=True):
    """A line that means something, for instance a feature that scanners see."""

    kind: str = msgspec.field(name="className", default="")
    line: Line = Line()


class Storage(Having, frozen=True, kw_only=True):
    """A bin."""

    point: str = msgspec.field(name="pointName", default="")


class StorageRow(Wire, frozen=True, kw_only=True):
    """Bins that were drawn together."""

    bins: list[Storage] = msgspec.field(name="binLocationList", default_factory=list)


class Header(Wire, frozen=True, kw_only=True):
    """What the map is; its bounding box is wrong in real files and not read."""

    map_name: str = ""


class Smap(Wire, frozen=True, kw_only=True):
    """The whole file."""

    header: Header
    points: list[PointMark] = msgspec.field(name="advancedPointList", default_factory=list)
    curves: list[Curve] = msgspec.field(name="advancedCurveList", default_factory=list)
    lines: list[Line] = msgspec.field(name="normalLineList", default_factory=list)
    named_lines: list[NamedLine] = msgspec.field(name="advancedLineList", default_factory=list)
    bin_rows: list[StorageRow] = msgspec.field(name="binLocationsList", default_factory=list)
