"""The one source of time: epoch milliseconds, perhaps faster than the wall, never back."""

import asyncio
import time
from pathlib import Path

import msgspec
import structlog

KEEP_S = 1.0  # so often a scaled clock's time is written down
KEPT_MS_MAX = 7_258_118_400_000  # the year 2200: beyond it, a kept time is damage
AHEAD_MS_MAX = 24 * 3_600_000  # of the wall, before an operator is told

log = structlog.get_logger()


class Clock(msgspec.Struct, frozen=True, kw_only=True):
    """Time that began at `base_ms` when the machine's monotonic clock stood at `started_ns`.

    Processes of one host share the monotonic clock, so the core hands its clock to its children
    and all three agree, also when time is scaled.
    """

    base_ms: int
    started_ns: int
    speed: float = 1.0

    @classmethod
    def start(cls, after_ms: int, speed: float) -> "Clock":
        """Start at the wall's time, or behind the newest event where that is later.

        A scaled clock runs ahead of the wall; after a restart it goes on from where it was.
        """
        return cls(
            base_ms=max(time.time_ns() // 1_000_000, after_ms),
            started_ns=time.monotonic_ns(),
            speed=speed,
        )

    def now_ms(self) -> int:
        """Give the scaled time."""
        return self.base_ms + int((time.monotonic_ns() - self.started_ns) / 1e6 * self.speed)

    def real_s(self, scaled_s: float) -> float:
        """Seconds on the wall for a stretch of scaled time."""
        return scaled_s / self.speed

    def text(self) -> str:
        """Form for a child's command line."""
        return f"{self.base_ms}:{self.started_ns}:{self.speed}"

    @classmethod
    def parse(cls, text: str) -> "Clock":
        """Read what `text` wrote."""
        base_ms, started_ns, speed = text.split(":")
        return cls(base_ms=int(base_ms), started_ns=int(started_ns), speed=float(speed))


def wall_ms() -> int:
    """Give the wall's time: people's sessions and keys do not go by scaled time."""
    return time.time_ns() // 1_000_000


def kept_time_ms(data: Path) -> int:
    """Read the time that no process of the last run has passed; 0 where nothing is kept."""
    path = data / "clock"
    try:
        text = path.read_text()
    except FileNotFoundError:
        return 0
    except (OSError, UnicodeDecodeError) as trouble:
        log.warning("kept time cannot be read and is passed over", reason=str(trouble))
        return 0
    text = text.strip()
    if not text.isdecimal() or len(text) > len(str(KEPT_MS_MAX)) or int(text) > KEPT_MS_MAX:
        log.warning("kept time is damaged and is passed over", path=str(path), text=text[:40])
        return 0
    return int(text)


def warn_if_ahead(clock: Clock, newest_ms: int, data: Path) -> None:
    """Tell an operator whose clock is far behind the ledger's; time goes on from there, not back.

    With a clock that runs faster than the wall that is as it should be.
    """
    ahead_ms = clock.base_ms - wall_ms()
    if clock.speed > 1 or ahead_ms <= AHEAD_MS_MAX:
        return
    from_events = newest_ms > wall_ms() + AHEAD_MS_MAX
    log.warning(
        "time is far ahead of this machine's clock",
        hours=ahead_ms // 3_600_000,
        because="the newest event is from then" if from_events else f"{data / 'clock'} says so",
        hint="If this machine's clock is wrong, set it. "
        + (
            "If the ledger's time is wrong, orders and events keep it until the machine's clock "
            "has caught up: what is written is never changed."
            if from_events
            else "If it is right, stop the server and delete that file."
        ),
    )


async def keep_time(data: Path, clock: Clock, every_s: float = KEEP_S) -> None:
    """Write down how far time may get before the next writing, until cancelled.

    Reports carry times between events, so the newest event alone does not tell where a scaled
    clock was; with this it never goes back over a restart (contract).
    """
    path = data / "clock"
    in_vain = False
    while True:
        ahead_ms = int(2 * KEEP_S * 1000 * clock.speed) if clock.speed > 1 else 0
        try:
            # ext4 writes a file out before its rename: not on the thread that answers
            await asyncio.to_thread(_replace, path, str(clock.now_ms() + ahead_ms))
            in_vain = False
        except OSError as trouble:
            if not in_vain:  # told once; what is kept is behind until the disk takes it again
                log.warning("time is not kept", reason=str(trouble))
            in_vain = True
        await asyncio.sleep(every_s)


def _replace(path: Path, text: str) -> None:
    fresh = path.with_name(f"{path.name}.new")
    fresh.write_text(text)
    fresh.replace(path)
