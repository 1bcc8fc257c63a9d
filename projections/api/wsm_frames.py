"""Frames of `/wsm`: read, answered, refused; and how replies are named (docs/api-websocket.md)."""

from enum import StrEnum
from typing import Any, TypeVar

import msgspec
from pydantic import BaseModel, ValidationError

from ledger.errors import LedgerError, Refused
from ledger.scene import Value

FRAME_CHARS_MAX = 65_536
ACTION_CHARS_MAX = 200
ID_CHARS_MAX = 200
ERROR = "::Error"
BAD_REQUEST, NOT_SIGNED_IN, SERVER_BUG = 400, 401, 500  # the three that clients know

Body = TypeVar("Body", bound=BaseModel)


class Naming(StrEnum):
    """How the action of a reply is called; a client may choose by `?naming=…`."""

    SEED = "seed"  # as the source writes it, where it does
    APPENDED = "appended"  # always the request's action and `::Reply`


# what the sources write otherwise than by appending (spec/m4.md §3 and C19)
_OF_SEED = {
    "Fleet::OrderDetail::Query": "Fleet::OrderDetail::Reply",
    "Fleet::Scene::Query": "Fleet::Scene::Query",
}


class Frame(Value, frozen=True, kw_only=True):
    """A request, as far as it could be read."""

    action: str = ""
    content: str = "{}"
    id: str | int | None = None


class BadFrame(Refused):
    """A frame that is none; as much of it as could be read names the refusal."""

    def __init__(self, frame: Frame, code: str, message: str, *args: object) -> None:
        super().__init__(code, message, *args)
        self.frame = frame


def read(text: str | None) -> Frame:
    """Read a frame; raises BadFrame."""
    nothing = Frame()
    if text is None:
        raise BadFrame(nothing, "errBadFrame", "Frames are text: send JSON as text.")
    if len(text) > FRAME_CHARS_MAX:
        words = f"A frame may have {FRAME_CHARS_MAX} characters."
        raise BadFrame(nothing, "errFrameTooLarge", words, FRAME_CHARS_MAX)
    try:
        raw = msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeEncodeError, RecursionError):
        words = 'A frame is JSON: {"id": "1", "action": "Fleet::Scene::Query", "content": "{…}"}.'
        raise BadFrame(nothing, "errBadJson", words) from None
    if not isinstance(raw, dict):
        raise BadFrame(nothing, "errBadFrame", "A frame is a JSON object.")
    return _checked(raw)


def _checked(raw: dict[str, Any]) -> Frame:
    id_, action, content = raw.get("id"), raw.get("action"), raw.get("content")
    id_good = id_ is None or _is_id(id_)
    known = Frame(id=id_ if id_good else None)
    if not isinstance(action, str) or not 0 < len(action) <= ACTION_CHARS_MAX:
        words = f"Field 'action' must be a text of 1 to {ACTION_CHARS_MAX} characters."
        raise BadFrame(known, "errFieldInvalid", words, "action")
    known = msgspec.structs.replace(known, action=action)
    if not id_good:
        words = f"Field 'id' must be a number or a text of at most {ID_CHARS_MAX} characters."
        raise BadFrame(known, "errFieldInvalid", words, "id")
    if content is not None and not isinstance(content, str):
        words = "Field 'content' must be a text that holds JSON."
        raise BadFrame(known, "errFieldInvalid", words, "content")
    return msgspec.structs.replace(known, content="{}" if content is None else content)


def _is_id(value: object) -> bool:
    if isinstance(value, str):
        return len(value) <= ID_CHARS_MAX
    return isinstance(value, int) and not isinstance(value, bool)


def content_of(frame: Frame, model: type[Body]) -> Body:
    """Read the content; raises Refused that names the field."""
    try:
        return model.model_validate_json(frame.content)
    except ValidationError as trouble:
        fault = trouble.errors(include_url=False, include_input=False)[0]
    except UnicodeEncodeError:
        raise Refused("errBadJson", "Field 'content' holds half of a character.") from None
    if fault["type"] == "json_invalid":
        words = f"Field 'content' must be a text that holds JSON: {fault['msg']}."
        raise Refused("errBadJson", words, "content")
    where = ".".join(["content", *(str(part) for part in fault["loc"])])
    if fault["type"] == "missing":
        raise Refused("errFieldMissing", f"Field '{where}' is required and missing.", where)
    words = fault["msg"].removeprefix("Value error, ")
    raise Refused("errFieldInvalid", f"Field '{where}' is wrong: {words}.", where)


def reply_action(action: str, naming: Naming) -> str:
    """Name the reply to an action."""
    appended = f"{action}::Reply"
    return _OF_SEED.get(action, appended) if naming is Naming.SEED else appended


def escaped(content: bytes) -> str:
    """Give the JSON of a content as frames hold it: as text, quotes and all."""
    return msgspec.json.encode(content.decode()).decode()


def encoded(action: str, content: str, reply_to: str | int | None = None) -> str:
    """Give the text of a frame from its content, escaped."""
    head = msgspec.json.encode(action).decode()
    tail = msgspec.json.encode(reply_to).decode()
    return f'{{"action":{head},"content":{content},"id":"","replyToId":{tail},"userIds":null}}'


def refusal(frame: Frame, error: int, code: str, message: str, args: tuple[object, ...]) -> str:
    """Give the text of an error frame."""
    body = {"error": error, "code": code, "message": message, "args": [*map(_plain, args)]}
    return encoded(f"{frame.action}{ERROR}", escaped(msgspec.json.encode(body)), frame.id)


def _plain(argument: object) -> object:
    return argument if isinstance(argument, str | int | float | bool | None) else str(argument)


def refusal_of(frame: Frame, trouble: Exception) -> str:
    """Give the error frame of an expected trouble, or of a bug of ours."""
    if isinstance(trouble, Refused):
        error = SERVER_BUG if trouble.status >= SERVER_BUG else BAD_REQUEST
        return refusal(frame, error, trouble.code, trouble.message, trouble.arguments)
    if isinstance(trouble, LedgerError):
        words = f"{trouble} {trouble.hint}"
        return refusal(frame, SERVER_BUG, "errLedgerUnavailable", words, ())
    words = "This is a bug of the server; its log has more."
    return refusal(frame, SERVER_BUG, "errServerBug", words, ())
