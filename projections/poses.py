"""Robots of one moment: reports of different times brought to the same instant."""

import math
from collections.abc import Iterable, Sequence

import msgspec

from ledger.link import Report

FRESH_MS = 1_500  # whoever reported that much before the newest report is not waited for
CARRIED_MS_MAX = 200  # a robot is taken to go on as it was for so long at most

replace = msgspec.structs.replace


def common_instant(newest: Iterable[Report]) -> int | None:
    """Give the newest instant at which all who report regularly have reported, or None."""
    times = [report.at_ms for report in newest]
    if not times:
        return None
    oldest_ms = max(times) - FRESH_MS
    return min([at_ms for at_ms in times if at_ms >= oldest_ms])


def around(reports: Sequence[Report], at_ms: int) -> tuple[Report | None, Report | None]:
    """Give the last report until the instant and the first behind it, or None where none is."""
    after = None
    for report in reversed(reports):
        if report.at_ms <= at_ms:
            return report, after
        after = report
    return None, after


def at_instant(reports: Sequence[Report], at_ms: int) -> Report:
    """Give the report of a robot for this instant, from its reports in order of time.

    The pose is interpolated between the reports around the instant; all else is of the earlier.
    """
    before, after = around(reports, at_ms)
    if before is None:
        return reports[0]  # it joined just now
    if after is None or after.area != before.area:
        return carried(before, at_ms)
    part = (at_ms - before.at_ms) / (after.at_ms - before.at_ms)
    turn_rad = math.remainder(after.heading_rad - before.heading_rad, math.tau)
    return replace(
        before,
        at_ms=at_ms,
        x_m=before.x_m + part * (after.x_m - before.x_m),
        y_m=before.y_m + part * (after.y_m - before.y_m),
        heading_rad=math.remainder(before.heading_rad + part * turn_rad, math.tau),
        speed_mps=before.speed_mps + part * (after.speed_mps - before.speed_mps),
        turn_radps=before.turn_radps + part * (after.turn_radps - before.turn_radps),
    )


def carried(report: Report, at_ms: int) -> Report:
    """Give the report for a later instant, the robot having gone on as it was for a moment."""
    dt_s = min(at_ms - report.at_ms, CARRIED_MS_MAX) / 1000
    if dt_s <= 0 or (report.speed_mps == 0 and report.turn_radps == 0):
        return replace(report, at_ms=at_ms)
    middle_rad = report.heading_rad + report.turn_radps * dt_s / 2
    return replace(
        report,
        at_ms=at_ms,
        x_m=report.x_m + report.speed_mps * dt_s * math.cos(middle_rad),
        y_m=report.y_m + report.speed_mps * dt_s * math.sin(middle_rad),
        heading_rad=math.remainder(report.heading_rad + report.turn_radps * dt_s, math.tau),
    )
