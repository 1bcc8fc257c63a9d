"""Wire models that several M4 calls share.

Types are strict, for JSON has types: the text "3" is no Int. Unknown fields are ignored, so that a
client written for a newer vendor release still works; a null field is an absent one.
"""

from typing import Annotated, Any

import msgspec
from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from commands.command import Decision
from commands.rejected import Reason, Rejected

TEXT_CHARS_MAX = 200
REMARK_CHARS_MAX = 2_000
OBJECT_CHARS_MAX = 100_000  # JSON text of an object that is only kept or passed on
INT_MAX = 2**31 - 1

Text = Annotated[str, StringConstraints(max_length=TEXT_CHARS_MAX)]
Remark = Annotated[str, StringConstraints(max_length=REMARK_CHARS_MAX)]
Int = Annotated[int, Field(ge=-(2**31), le=INT_MAX)]


class Wire(BaseModel):
    """Base of request models."""

    model_config = ConfigDict(strict=True, extra="ignore", frozen=True)


class ParallelResult(BaseModel):
    """What became of one entry of a batch (spec/m4.md, ParallelResult)."""

    ok: bool = Field(description="Whether it succeeded.")
    result: dict[str, Any] = Field({}, description="Nothing is ever said here.")
    errMsg: str | None = Field(None, description="The reason if it failed.")


_GOOD = {"ok": True, "result": {}, "errMsg": None}


def parallel_results(keys: list[str], decision: Decision) -> bytes:
    """Answer for every key that was asked for."""
    results = {
        key: {"ok": False, "result": {}, "errMsg": decision.refused[key].message}
        if key in decision.refused
        else _GOOD
        for key in keys
    }
    return msgspec.json.encode(results)


def json_text(value: dict[str, Any], field: str) -> str:
    """Keep a client's JSON as text; refuse what is too long."""
    text = msgspec.json.encode(value).decode()
    if len(text) > OBJECT_CHARS_MAX:
        message = f"Field '{field}' may have {OBJECT_CHARS_MAX} characters of JSON."
        raise Rejected(Reason.FIELD_INVALID, message, field)
    return text
