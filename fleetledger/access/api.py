"""HTTP of access: signing in and out, and for admins users and keys (docs/access.md)."""

import secrets
from typing import Any

import msgspec
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from fleetledger.access.callers import TOKEN_COOKIE, USER_COOKIE, Caller
from fleetledger.access.file import digest_of, new_key
from fleetledger.access.models import (
    AddKeyAsked,
    AddUserAsked,
    ChangePasswordAsked,
    KeyAnswer,
    NamedKey,
    NamedUser,
    NewKeyAnswer,
    PingAnswer,
    RotateKeyAsked,
    SignInAnswer,
    SignInAsked,
    UpdateUserAsked,
    UserAnswer,
)
from fleetledger.access.passwords import check_form
from fleetledger.access.registry import (
    Change,
    key_added,
    key_removed,
    key_rotated,
    user_added,
    user_changed,
    user_removed,
)
from fleetledger.access.roles import RANK
from fleetledger.access.service import Access
from fleetledger.access.sessions import AGE_MS
from fleetledger.http import ThinRoute
from ledger.errors import Refused
from ledger.events import Role

PERMISSIONS = ("view", "operate", "administer")  # by rank


class Forbidden(Refused):
    """Known, but not allowed."""

    status = 403


def router(access: Access) -> APIRouter:
    """Make the routes."""
    made = APIRouter(route_class=ThinRoute, tags=["access"])
    _ping(made)
    _signing(made, access)
    _users(made, access)
    _keys(made, access)
    return made


def _ping(made: APIRouter) -> None:
    @made.get("/api/ping", response_model=PingAnswer)
    async def ping(request: Request) -> Response:
        """Tell who the caller is, once the server is ready."""
        name, role = request.state.user, request.state.role
        return _json(
            {
                "id": name,
                "username": name,
                "roAdmin": role is Role.ADMIN,
                "permissions": PERMISSIONS[: RANK[role]],
            }
        )


def _signing(made: APIRouter, access: Access) -> None:
    @made.post("/api/sign-in", response_model=SignInAnswer, openapi_extra={"security": []})
    async def sign_in(request: Request, body: SignInAsked) -> Response:
        """Begin a session: its id and token go into headers, or a browser's cookies, of calls.

        Wrong ones are answered 400; after some of them the next try must wait (429, Retry-After).
        """
        token = await access.sign_in(body.username, body.password, _address(request))
        answer = _json({"userId": body.username, "userToken": token})
        _set_cookies(request, answer, body.username, token, AGE_MS // 1000)
        return answer

    @made.post("/api/sign-out")
    async def sign_out(request: Request) -> Response:
        """End the session that the call came with; without one nothing happens."""
        caller: Caller | None = request.state.caller
        answer = Response()
        if caller is not None and caller.token:
            await access.sign_out(caller.name, caller.token)
            _set_cookies(request, answer, "", "", 0)
        return answer

    @made.post("/api/access/password")
    async def change_password(request: Request, body: ChangePasswordAsked) -> Response:
        """Change one's own password; all one's sessions end, this one too."""
        caller: Caller | None = request.state.caller
        if not access.enforced or caller is None or caller.app:
            raise Forbidden("errForbidden", "Only a user who signed in has a password.")
        check_form(body.newPassword, "newPassword")
        await access.check_password(caller.name, body.password, _address(request))
        password = await access.passwords.hashed(body.newPassword)
        change = user_changed(caller.name, password=password, stamp=_stamp())
        await _change(access, request, change)
        return Response()


def _users(made: APIRouter, access: Access) -> None:
    @made.get("/api/access/users", response_model=list[UserAnswer])
    async def users(request: Request) -> Response:
        """List the users."""
        known = sorted(access.file.registry.users.items())
        return _json(
            [{"username": n, "role": user.role, "disabled": user.disabled} for n, user in known]
        )

    @made.post("/api/access/users/add")
    async def add_user(request: Request, body: AddUserAsked) -> Response:
        """Let a person sign in."""
        check_form(body.password)
        password = await access.passwords.hashed(body.password)
        await _change(access, request, user_added(body.username, body.role, password, _stamp()))
        return Response()

    @made.post("/api/access/users/update")
    async def update_user(request: Request, body: UpdateUserAsked) -> Response:
        """Change role, password or being disabled; in force at once."""
        password = None
        if body.password is not None:
            check_form(body.password)
            password = await access.passwords.hashed(body.password)
        change = user_changed(
            body.username,
            role=body.role,
            password=password,
            disabled=body.disabled,
            stamp=_stamp(),
        )
        await _change(access, request, change)
        return Response()

    @made.post("/api/access/users/remove")
    async def remove_user(request: Request, body: NamedUser) -> Response:
        """Let a person sign in no more; the sessions end."""
        await _change(access, request, user_removed(body.username))
        return Response()


def _keys(made: APIRouter, access: Access) -> None:
    @made.get("/api/access/keys", response_model=list[KeyAnswer])
    async def keys(request: Request) -> Response:
        """List the key pairs of machine clients, without the keys."""
        now_ms = access.now_ms()
        return _json(
            [
                {
                    "appId": app,
                    "role": key.role,
                    "oldKeyValidUntil": key.old.until_ms
                    if key.old is not None and key.old.until_ms > now_ms
                    else None,
                }
                for app, key in sorted(access.file.registry.keys.items())
            ]
        )

    @made.post("/api/access/keys/add", response_model=NewKeyAnswer)
    async def add_key(request: Request, body: AddKeyAsked) -> Response:
        """Make a key pair; its key is in the answer, and never again anywhere."""
        key = new_key()
        await _change(access, request, key_added(body.appId, body.role, digest_of(key)))
        return _json({"appId": body.appId, "appKey": key})

    @made.post("/api/access/keys/rotate", response_model=NewKeyAnswer)
    async def rotate_key(request: Request, body: RotateKeyAsked) -> Response:
        """Make another key for a client; the one of now stays good for a while."""
        key = new_key()
        until_ms = access.now_ms() + body.graceMinutes * 60_000
        await _change(access, request, key_rotated(body.appId, digest_of(key), until_ms))
        return _json({"appId": body.appId, "appKey": key})

    @made.post("/api/access/keys/remove")
    async def remove_key(request: Request, body: NamedKey) -> Response:
        """Take a key pair back, at once."""
        await _change(access, request, key_removed(body.appId))
        return Response()


async def _change(access: Access, request: Request, change: Change) -> None:
    """Refuse it where anybody may call: such a server would make admins of later ones."""
    if not access.enforced:
        words = "This server runs with --auth none: change access by the command line."
        raise Forbidden("errAccessOff", words)
    await access.change(change, request.state.user)


def _json(body: Any) -> Response:
    headers = {"Cache-Control": "no-store"}
    return Response(msgspec.json.encode(body), headers=headers, media_type="application/json")


def _set_cookies(request: Request, answer: Response, user: str, token: str, age_s: int) -> None:
    """Name them after the port, as M4 does: browsers share cookies among the ports of a host."""
    port = request.scope["server"][1]
    for name, value, hidden in ((USER_COOKIE, user, False), (TOKEN_COOKIE, token, True)):
        answer.set_cookie(
            f"{name}{port}",
            value,
            max_age=age_s,
            secure=request.url.scheme == "https",
            httponly=hidden,
            samesite="strict",
        )


def _address(request: Request) -> str:
    return request.client.host if request.client is not None else ""


def _stamp() -> str:
    return secrets.token_hex(8)
