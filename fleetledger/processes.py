"""Starts the scheduler and the simulator, starts them again if they die, and stops them."""

import asyncio
import contextlib
import sys
from collections.abc import Sequence

import structlog
from prometheus_client import Counter

from fleetledger.clock import Clock
from fleetledger.config import Settings
from fleetledger.listening import free_port

log = structlog.get_logger()

RESTARTS = Counter("fleetledger_child_restarts", "Children started again", ["process"])
BACKOFF_S = (0.2, 1.0, 2.0, 5.0, 10.0)  # before each new try; the last one repeats
HEALTHY_S = 60.0  # who lived that long starts over with short pauses
STOP_S = 2.0  # then it is killed: the whole server has 5 s (contract)


class Child:
    """One child process. It watches its standard input: when that closes, also because this
    process was killed, it ends by itself, so that nothing is left behind.
    """

    def __init__(self, name: str, arguments: Sequence[str]) -> None:
        """Take the role's name and its command line behind `fleetledger role`."""
        self.name = name
        self._arguments = tuple(arguments)
        self._process: asyncio.subprocess.Process | None = None
        self._watch: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Start it, and keep it running."""
        await self._spawn()
        self._watch = asyncio.create_task(self._keep_running(), name=f"keep {self.name}")

    async def _spawn(self) -> None:
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "fleetledger",
            "role",
            self.name,
            *self._arguments,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C goes to the server, which stops its children in order
        )

    async def _keep_running(self) -> None:
        loop = asyncio.get_running_loop()
        tries = 0
        while True:
            assert self._process is not None
            began = loop.time()
            code = await self._process.wait()
            tries = 0 if loop.time() - began > HEALTHY_S else tries + 1
            pause_s = BACKOFF_S[min(tries, len(BACKOFF_S) - 1)]
            log.error("child ended", child=self.name, exit_code=code, again_in_s=pause_s)
            await asyncio.sleep(pause_s)
            RESTARTS.labels(self.name).inc()
            await self._spawn()

    async def stop(self) -> None:
        """Ask it to end, and kill it if it does not."""
        if self._watch is not None:
            self._watch.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._watch
        if self._process is None or self._process.returncode is not None:
            return
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.terminate()  # ends one that is still starting, and asks one that runs
        try:
            await asyncio.wait_for(self._process.wait(), STOP_S)
        except TimeoutError:
            log.warning("child killed", child=self.name)
            self._process.kill()
            await self._process.wait()


def children_of(settings: Settings, clock: Clock, core: str) -> list[Child]:
    """Name the processes to be started; robots of a plant connect to both endpoints as well."""
    scheduler = f"tcp/127.0.0.1:{free_port()}"
    common = ["--clock", clock.text(), "--data", str(settings.data)]
    children = [Child("scheduler", ["--listen", scheduler, "--connect", core, *common])]
    if settings.simulate:
        seed = ["--seed", str(settings.seed), "--faults", settings.faults]
        children.append(Child("sim", ["--connect", core, "--connect", scheduler, *seed, *common]))
    return children
