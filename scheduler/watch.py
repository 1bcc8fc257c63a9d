"""What we remember of a robot from report to report; lost at a restart, and only delays then."""

import msgspec

from ledger.link import Report
from ledger.scene import Value

MOVED_M = 0.05  # less than this is localisation noise
TURNED_RAD = 0.1


class Watch(Value, frozen=True, kw_only=True):
    """A robot as it has been seen to move and charge."""

    x_m: float
    y_m: float
    heading_rad: float
    still_since_ms: int
    charging_since_ms: int | None


def watched(before: Watch | None, report: Report, now_ms: int) -> Watch:
    """Take one more report in, at the moment it came."""
    charging_since_ms = None
    if report.charging:
        known = before.charging_since_ms if before is not None else None
        charging_since_ms = known if known is not None else now_ms
    if before is not None and not has_moved(before, report):
        return msgspec.structs.replace(before, charging_since_ms=charging_since_ms)
    return Watch(
        x_m=report.x_m,
        y_m=report.y_m,
        heading_rad=report.heading_rad,
        still_since_ms=now_ms,
        charging_since_ms=charging_since_ms,
    )


def has_moved(before: Watch, report: Report) -> bool:
    """Tell whether the robot is somewhere else than where it came to rest."""
    far = max(abs(report.x_m - before.x_m), abs(report.y_m - before.y_m)) > MOVED_M
    return far or abs(report.heading_rad - before.heading_rad) > TURNED_RAD
