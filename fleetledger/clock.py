"""The one source of time: epoch milliseconds, perhaps faster than the wall, never back."""

import time

import msgspec


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
