"""Ledgers in every shape that a release wrote, kept for ever.

`python -m tests.ledger.fixtures NAME` writes one in today's shape.

A folder each: segments and a snapshot (gzip), the state as that program had it, and what it was.
The old ones were written by the programs of their time; they are never written again.
"""

import gzip
import hashlib
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import msgspec

from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.codec import schema_of
from ledger.events import (
    EVENTS,
    AccessRefused,
    AnswersWindowSet,
    AnyEvent,
    CallbackGivenUp,
    CallbacksConfigured,
    DoorCloseAsked,
    KeyAdded,
    KeyRemoved,
    OrderWithdrawn,
    RobotBinsCleared,
    RobotControlTaken,
    RobotSoftStopLifted,
    RobotSoftStopped,
    RobotsWaited,
    Role,
    SceneConfigured,
    SceneImported,
    SceneRemoved,
    SceneRenamed,
    SignedIn,
    SignedOut,
    UserAdded,
    UserChanged,
    UserRemoved,
    stamped,
)
from ledger.evolve import fold
from ledger.ids import CommandId, SceneId
from ledger.scene import Value
from ledger.scene_config import SceneConfig
from ledger.snapshot import save
from ledger.state import Fleet, OrderStatus
from ledger.waits import CycleSeen, WaitReason, WaitSum
from tests.histories import history
from tests.ledger.folders import in_threes, written
from tests.strategies import SCENE

FOLDER = Path(__file__).parents[1] / "fixtures" / "ledgers"
SEED, COUNT = 335, 420  # a history in which much happens
SEGMENT_CHUNKS = 100


class Kept(Value, frozen=True, kw_only=True):
    """What a folder holds, in `fixture.json`."""

    name: str
    position: int
    vocabulary: str  # digest of the events' schemas, as that program had them


def vocabulary() -> str:
    """Give the digest of today's event schemas."""
    sha = hashlib.sha256()
    for kind in sorted(EVENTS, key=lambda kind: kind.__name__):
        sha.update(kind.__name__.encode() + b"\0" + schema_of(kind) + b"\0")
    return sha.hexdigest()


def kept() -> list[Kept]:
    """Name what is kept, the newest last: names begin with a number."""
    files = sorted(FOLDER.glob("*/fixture.json"))
    return [msgspec.json.decode(file.read_bytes(), type=Kept) for file in files]


def unpacked(name: str, data: Path) -> Path:
    """Lay a kept ledger out as a data folder."""
    for path in sorted((FOLDER / name).glob("*.gz")):
        target = data / ("ledger" if ".mcap" in path.name else "snapshots") / path.stem
        if path.name != STATE:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(gzip.decompress(path.read_bytes()))
    return data


STATE = "state.json.gz"


def state_then(name: str) -> bytes:
    """Give the canonical state as the program had it that wrote the ledger."""
    return gzip.decompress((FOLDER / name / STATE).read_bytes())


def _rest(fleet: Fleet) -> Iterator[AnyEvent]:
    """What the history leaves out; a kind that stands nowhere is missed by a test."""
    robots = [robot.name for robot in fleet.robots.values()]
    assigned = next(o for o in fleet.orders.values() if o.robot and not o.loaded)
    assert assigned.robot is not None
    assert assigned.status is not OrderStatus.DONE
    gone = SceneId("5" * 24)
    yield OrderWithdrawn(scene=SCENE, order=assigned.id, robot=assigned.robot, reason="RobotLost")
    yield RobotBinsCleared(scene=SCENE, robot=robots[0])
    yield RobotSoftStopped(scene=SCENE, robot=robots[0])
    yield RobotSoftStopLifted(scene=SCENE, robot=robots[0])
    yield RobotControlTaken(scene=SCENE, robot=robots[0], gently=True)
    yield SceneRenamed(scene=SCENE, name="Hall A", display_order=2)
    yield DoorCloseAsked(scene=SCENE, door=1, remark="draught")
    yield SceneConfigured(scene=SCENE, config=SceneConfig(state_fetch_ms=500))
    urls = ("http://127.0.0.1:9/told",)
    config = CallbackConfig(enabled=True, statuses=(CallbackStatus.DONE,), urls=urls)
    yield CallbacksConfigured(scene=SCENE, callbacks=config)
    yield CallbackGivenUp(
        scene=SCENE,
        order=assigned.id,
        url=urls[0],
        status=CallbackStatus.DONE,
        of_position=3,
        reason="refused",
    )
    yield SceneImported(scene=gone, name="Annex", digest="e" * 64, areas=(), groups=())
    yield SceneRemoved(scene=gone)
    nowhere = SceneId("")
    yield UserAdded(scene=nowhere, user="eve", role=Role.VIEWER)
    yield UserChanged(scene=nowhere, user="eve", role=Role.OPERATOR, password=True)
    yield SignedIn(scene=nowhere, user="eve", address="127.0.0.1")
    yield SignedOut(scene=nowhere, user="eve")
    yield UserRemoved(scene=nowhere, user="eve")
    yield KeyAdded(scene=nowhere, app="wms", role=Role.OPERATOR, rotated=True)
    yield KeyRemoved(scene=nowhere, app="wms")
    yield AccessRefused(
        scene=nowhere, caller="mallory", address="10.0.0.9", call="GET /", code="errNotSignedIn"
    )
    yield AnswersWindowSet(scene=nowhere, count_max=5_000, age_s_max=3_600)
    ring = CycleSeen(robots=tuple(robots[:2]), from_ms=5, until_ms=9_000)
    reason, blockers = WaitReason.BEHIND_ROBOT, (robots[1],)
    waited = WaitSum(robot=robots[0], reason=reason, blockers=blockers, total_ms=8_995)
    yield RobotsWaited(
        scene=SCENE, from_ms=5, waits=(waited,), cycles=(ring,), plannings={"Goals": 3}
    )


def story() -> list[AnyEvent]:
    """Every kind of event at least once, in an order that makes sense."""
    events = history(SEED, COUNT)
    fleet = fold(Fleet(), events)
    for blank in _rest(fleet):
        place = len(events) + 1
        events.append(stamped(blank, place, fleet.at_ms + place, "keeper", CommandId(f"c{place}")))
    return events


def write(name: str) -> Kept:
    """Write a ledger of today's shape."""
    events = story()
    folder = FOLDER / name
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    with tempfile.TemporaryDirectory() as scratch:
        data = Path(scratch)
        written(data / "ledger", in_threes(events), segment_chunks_max=SEGMENT_CHUNKS)
        save(data / "snapshots", fold(Fleet(), events[: COUNT // 2]))
        for path in sorted(data.glob("*/*")):
            if path.suffix in (".mcap", ".snapshot"):
                _pack(folder / f"{path.name}.gz", path.read_bytes())
    _pack(folder / STATE, fold(Fleet(), events).canonical())
    made = Kept(name=name, position=len(events), vocabulary=vocabulary())
    (folder / "fixture.json").write_bytes(msgspec.json.encode(made) + b"\n")
    return made


def _pack(path: Path, raw: bytes) -> None:
    path.write_bytes(gzip.compress(raw, mtime=0))


if __name__ == "__main__":
    print(write(sys.argv[1]))
