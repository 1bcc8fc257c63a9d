"""Access of a running server: who calls, who signs in, who changes it, and the audit of it all."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Sequence
from math import ceil
from pathlib import Path

import structlog

from commands.access import RecordAccess
from commands.handle import Handler
from fleetledger.access.callers import Anybody, Callers, KnownCallers
from fleetledger.access.file import AccessFile
from fleetledger.access.guesses import Attempts
from fleetledger.access.passwords import Passwords
from fleetledger.access.refusals import Refusals
from fleetledger.access.registry import EVERYWHERE, Change, Registry, User, known_user
from fleetledger.access.sessions import Sessions
from fleetledger.http import Later
from ledger.errors import LedgerError, Refused
from ledger.events import AccessEvent, SignedIn, SignedOut
from ledger.ids import CommandId

log = structlog.get_logger()

LOOK_S = 1.0  # between two looks at the file, which the command line may have changed
TELL_S = 60.0  # refusals are counted so long, and uses of sessions are not on disk yet
GATE = "fleetledger-gate"  # author of what nobody known caused

Durable = Callable[[int], Awaitable[None]]


class Access:
    """Everything about access that one server has."""

    def __init__(
        self,
        data: Path,
        *,
        enforced: bool,
        handler: Handler,
        durable: Durable,
        now_ms: Callable[[], int],
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Read the files; `now_ms` is the wall's time, for access does not go by scaled time."""
        self.enforced = enforced
        self.file = AccessFile(data, now_ms)
        self.sessions = Sessions(data, now_ms)
        self.passwords = Passwords()
        self.known = KnownCallers(self._registry, self.sessions, now_ms)
        self.callers: Callers = self.known if enforced else Anybody()
        self.refusals = Refusals()
        self.now_ms = now_ms
        self._attempts = Attempts()
        self._handler = handler
        self._durable = durable
        self._now_s = now_s
        self._telling = asyncio.Lock()

    def _registry(self) -> Registry:
        return self.file.registry

    async def sign_in(self, name: str, password: str, address: str) -> str:
        """Begin a session and give its token; refuses alike whatever is wrong.

        Tries beyond the limits are not even looked at.
        """
        wait_s = self._attempts.begin(name, address, self._now_s())
        if wait_s > 0:
            self.refusals.refused(name[:100], address, "POST /api/sign-in", "errTooManyTries")
            words = f"Too many tries: wait {ceil(wait_s)} s."
            raise Later("errTooManyTries", words, ceil(wait_s))
        user = self._registry().users.get(name)
        try:
            right = await self.passwords.match(user.password if user else None, password)
        except Later:
            self._attempts.undo(name, address)
            raise
        if not right or user is None or user.disabled or not self._is_still(name, user):
            self.refusals.refused(name[:100], address, "POST /api/sign-in", "errSignInFailed")
            raise Refused("errSignInFailed", "User name or password is wrong.")
        self._attempts.right(name, address)
        token = self.sessions.begin(name, user)
        await self.sessions.keep()
        await self._state(name, SignedIn(scene=EVERYWHERE, user=name, address=address))
        return token

    async def sign_out(self, name: str, token: str) -> None:
        """End a session."""
        self.sessions.end(token)
        await self.sessions.keep()
        await self._state(name, SignedOut(scene=EVERYWHERE, user=name))

    async def check_password(self, name: str, password: str, address: str) -> None:
        """Let a person who changes the password say the one of now, limited as signing in is."""
        wait_s = self._attempts.begin(name, address, self._now_s())
        if wait_s > 0:
            raise Later("errTooManyTries", f"Too many tries: wait {ceil(wait_s)} s.", ceil(wait_s))
        user = known_user(self._registry(), name)
        if not await self.passwords.match(user.password, password):
            self.refusals.refused(name, address, "POST /api/access/password", "errPasswordWrong")
            raise Refused("errPasswordWrong", "Field 'password' is not the password of now.")
        self._attempts.right(name, address)

    async def change(self, change: Change, by: str) -> Registry:
        """Make a change and tell the ledger of it; in force and on disk when this returns."""
        registry = await asyncio.to_thread(self.file.change, change, by)
        await self.tell_changes()
        return registry

    async def tell_changes(self) -> None:
        """State the changes that the ledger does not have yet, the command line's too.

        After a crash in between one may be stated twice, but none is lost.
        """
        async with self._telling:
            untold = self.file.registry.untold
            if not untold:
                return
            for told in untold:
                at_ms = min(told.at_ms, self._handler.now_ms())
                position = self._append(told.by, at_ms, (told.event,))
            await self._durable(position)
            await asyncio.to_thread(self.file.told, untold)

    async def tell_refusals(self) -> None:
        """State what was refused since the last time."""
        refused = self.refusals.taken()
        if not refused:
            return
        try:
            position = self._append(GATE, self._handler.now_ms(), refused)
        except LedgerError:
            self.refusals.put_back(refused)
            raise
        await self._durable(position)

    async def watch(self) -> None:
        """Look after the files and the audit until cancelled."""
        told_s = self._now_s()
        trouble_before = ""
        while True:
            await asyncio.sleep(LOOK_S)
            try:
                await self._look(self._now_s() - told_s >= TELL_S)
                trouble_before = ""
            except (Refused, OSError, LedgerError) as trouble:
                # what is in force stays in force; next second we look again
                if type(trouble).__name__ != trouble_before:
                    trouble_before = type(trouble).__name__
                    log.error("access is not looked after", reason=str(trouble))
            if self._now_s() - told_s >= TELL_S:
                told_s = self._now_s()

    async def close(self) -> None:
        """Leave nothing untold or unwritten."""
        try:
            await self.tell_changes()
            await self.tell_refusals()
            await self.sessions.keep()
        except (Refused, OSError, LedgerError) as trouble:
            log.error("the end of the audit is missing", reason=str(trouble))

    async def _look(self, tell: bool) -> None:
        if await asyncio.to_thread(self.file.refresh):
            log.info("access changed", users=len(self._registry().users))
        await self.tell_changes()
        if tell:
            await self.tell_refusals()
            self.sessions.tidy(self.known.holds)
            await self.sessions.keep()

    def _is_still(self, name: str, user: User) -> bool:
        """See whether the user is as when the password's check began."""
        now = self._registry().users.get(name)
        return now is not None and now.stamp == user.stamp and not now.disabled

    async def _state(self, by: str, event: AccessEvent) -> None:
        await self._durable(self._append(by, self._handler.now_ms(), (event,)))

    def _append(self, by: str, at_ms: int, events: Sequence[AccessEvent]) -> int:
        command = RecordAccess(
            id=CommandId(self._handler.new_id()), by=by, at_ms=at_ms, events=tuple(events)
        )
        return self._handler.handle(command).position
