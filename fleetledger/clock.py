"""The one source of time: epoch milliseconds, perhaps faster than the wall, never back."""

import asyncio
import time
from pathlib import Path

import msgspec

KEEP_S = 1.0  # so often a scaled clock's time is written down


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
    return int(path.read_text()) if path.exists() else 0


async def keep_time(data: Path, clock: Clock) -> None:
    """Write down how far time may get before the next writing, until cancelled.

    Reports carry times between events, so the newest event alone does not tell where a scaled
    clock was; with this it never goes back over a restart (contract).
    """
    path, fresh = data / "clock", data / "clock.new"
    while True:
        ahead_ms = int(2 * KEEP_S * 1000 * clock.speed) if clock.speed > 1 else 0
        fresh.write_text(str(clock.now_ms() + ahead_ms))
        fresh.replace(path)
        await asyncio.sleep(KEEP_S)
