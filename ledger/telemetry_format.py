"""How reports and plans lie in `telemetry/`: file names, topics, and the batches in the messages.

A batch holds what changed with the robots of one scene since the last one; every few seconds a
*whole* batch holds the newest of all robots, so that a reader never has to go back far. A report is
written whole where more than motion has changed (`telemetry_motion`), else as steps from the last.
"""

from datetime import UTC, datetime
from pathlib import Path

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import Plan, Report, Space
from ledger.scene import Value

REPORTS_TOPIC = "/fleet/reports"
PLANS_TOPIC = "/fleet/plans"
SUFFIX = ".mcap"
NS_PER_MS = 1_000_000

WHOLE_EVERY_MS = 10_000  # between two whole batches
LOOK_BACK_MS = 3_600_000  # a stretch without a batch of the scene; beyond it nothing is looked for
SILENT_MS_MAX = 7 * 24 * 3_600_000  # a robot silent for longer is not in a whole batch any more
SPREAD_MS = 2_000  # reports of one batch are at most so much older than its newest


class Head(Value, frozen=True, kw_only=True):
    """The front of a batch: enough to know whether the rest is worth decoding."""

    scene: SceneId
    at_ms: int  # when it was written; never less than in the batch before
    whole: bool  # holds the newest of every robot of the scene, not only what changed
    whole_ms: int = 0  # `at_ms` of the whole batch that this one goes on from
    since: int = 0  # batches of this scene since that one; a gap means that one is missing


class Moved(Value, frozen=True, kw_only=True):
    """Robots of which only motion has changed, in columns: alike numbers side by side pack best."""

    robots: tuple[RobotName, ...]
    steps: tuple[tuple[int, ...], ...]  # a column for each of `telemetry_motion.MOTION`
    points: tuple[PointName | None, ...]


class ReportBatch(Head, frozen=True, kw_only=True):
    """One message of the topic of reports."""

    items: tuple[Report, ...]
    moved: Moved | None = None


class PlanBatch(Head, frozen=True, kw_only=True):
    """One message of the topic of plans.

    Ground is stated once and then named by its number: plans are written without their spaces,
    which are `held`, in the same order as `items`. Older files have neither.
    """

    items: tuple[Plan, ...]
    held: tuple[tuple[int, ...], ...] = ()
    first_space: int = 0  # number of the first of `spaces`; counted anew from each whole batch
    spaces: tuple[Space, ...] = ()


def file_name(at_ms: int, again: int = 0) -> str:
    """Name a file by its first moment, UTC; `again` counts files of the same second."""
    moment = datetime.fromtimestamp(at_ms // 1000, UTC)
    suffix = f"-{again}" if again else ""
    return f"{moment:%Y%m%dT%H%M%SZ}{suffix}{SUFFIX}"


def file_key(path: Path) -> tuple[int, int] | None:
    """Give (start in epoch milliseconds, number within the second); None = not one of ours."""
    stamp, _, again = path.name.removesuffix(SUFFIX).partition("-")
    try:
        moment = datetime.strptime(stamp, "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
        return int(moment.timestamp()) * 1000, int(again or 0)
    except ValueError:
        return None


def files(directory: Path) -> list[tuple[int, Path]]:
    """List (start in milliseconds, file), oldest first; a missing folder has none."""
    if not directory.is_dir():
        return []
    found = [(key, path) for path in directory.glob(f"*{SUFFIX}") if (key := file_key(path))]
    return [(key[0], path) for key, path in sorted(found)]
