"""Callbacks: who is told of the states of a scene's orders, and what could not be told."""

import re
from urllib.parse import urlsplit

from commands.command import Command, Decision, at_most, known_scene
from commands.rejected import Reason, Rejected
from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.events import CallbackGivenUp, CallbacksConfigured
from ledger.ids import OrderId, SceneId
from ledger.state import Fleet

URLS_MAX = 10
URL_CHARS_MAX = 2_000
RETRIES_MAX = 10_000  # with a minute between them: a week
RETRY_S_MIN, RETRY_S_MAX = 0.1, 60.0
REASON_CHARS_MAX = 200
SCHEMES = ("http", "https")

_plain = re.compile(r"[\x21-\x7e]+", re.ASCII)  # what a URL may hold: no space, no control


class ConfigureCallbacks(Command, frozen=True, kw_only=True):
    """Choose who is told of the orders' states, and how insistently."""

    scene: SceneId
    callbacks: CallbackConfig  # all of it


def configure(fleet: Fleet, command: ConfigureCallbacks) -> Decision:
    """What has happened before is told as it was settled before."""
    scene = known_scene(fleet, command.scene)
    config = command.callbacks
    at_most(len(config.urls), URLS_MAX, "callbackUrlList")
    for index, url in enumerate(config.urls):
        _check_url(url, f"callbackUrlList.{index}")
        if url in config.urls[:index]:
            raise _wrong(f"callbackUrlList.{index}", "it is in the list twice")
    if config.enabled and not config.urls:
        raise _wrong("callbackUrlList", "to enable callbacks give at least one URL")
    if not 0 <= config.retries_max <= RETRIES_MAX:
        raise _wrong("retryTimes", f"0 to {RETRIES_MAX} are possible")
    if not RETRY_S_MIN <= config.retry_s <= RETRY_S_MAX:
        raise _wrong("retryInterval", f"{RETRY_S_MIN} to {RETRY_S_MAX} seconds are possible")
    if config == scene.callbacks:
        return Decision()
    return Decision(events=(CallbacksConfigured(scene=scene.id, callbacks=config),))


class GiveUpCallback(Command, frozen=True, kw_only=True):
    """State that a callback was not accepted however often it was sent (from the sender)."""

    scene: SceneId
    order: OrderId
    url: str
    status: CallbackStatus
    of_position: int
    reason: str


def give_up(fleet: Fleet, command: GiveUpCallback) -> Decision:
    """Keep it for the record; the scene may be disabled or removed by now."""
    if command.scene not in fleet.scenes:
        return Decision()
    event = CallbackGivenUp(
        scene=command.scene,
        order=command.order,
        url=command.url,
        status=command.status,
        of_position=command.of_position,
        reason=command.reason[:REASON_CHARS_MAX],
    )
    return Decision(events=(event,))


def _check_url(url: str, field: str) -> None:
    """Refuse what is no address of a receiver; names and passwords in it would end up in logs."""
    if len(url) > URL_CHARS_MAX:
        raise _wrong(field, f"it may have {URL_CHARS_MAX} characters")
    if not _plain.fullmatch(url):
        raise _wrong(field, "it may hold ASCII characters only, and no spaces")
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise _wrong(field, "it is no URL") from None
    if parts.scheme not in SCHEMES or not host or port == 0:
        raise _wrong(field, "it must be like http://host[:port]/path, or https://…")
    if "@" in parts.netloc:
        raise _wrong(field, "it must not hold a user name or password")
    if "#" in url:
        raise _wrong(field, "it must not hold a fragment ('#')")


def _wrong(field: str, words: str) -> Rejected:
    return Rejected(Reason.FIELD_INVALID, f"Field '{field}' is wrong: {words}.", field)
