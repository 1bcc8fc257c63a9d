from pathlib import Path

import msgspec
import pytest

from ledger.events import AnyEvent, CommandAnswered
from ledger.evolve import fold
from ledger.ids import CommandId, OrderId, SceneId
from ledger.snapshot import (
    Snapshotter,
    Unusable,
    load,
    nearest,
    restore,
    save,
    snapshot_paths,
    to_bytes,
)
from ledger.state import STATE_VERSION, AnswersWindow, Fleet
from ledger.store import FileLedger, MemoryLedger
from tests.histories import history
from tests.ledger.folders import in_threes, written

EVENTS = history(31, 300)


def fleet_at(position: int) -> Fleet:
    return fold(Fleet(), EVENTS[:position])


def test_a_saved_state_is_loaded_as_it_was(tmp_path: Path) -> None:
    fleet = fleet_at(200)
    path = save(tmp_path / "snapshots", fleet)
    assert path.name == "00000000000000000200.snapshot"
    assert to_bytes(load(path)) == to_bytes(fleet)
    assert save(tmp_path / "snapshots", fleet) == path
    assert [p.name for p in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("orders", [0, 1, 99, 100, 101, 350])
def test_a_state_encoded_in_pieces_is_the_state_encoded_whole(orders: int) -> None:
    fleet = fleet_at(200)
    some = next(iter(fleet.orders.values()))
    fleet.orders = {OrderId(f"{n}"): some for n in range(orders)}
    pauses: list[None] = []
    written = to_bytes(fleet, lambda: pauses.append(None))
    assert written.split(b"\n", 1)[1] == msgspec.json.encode(fleet)
    assert len(pauses) > orders / 100  # whoever waits gets a turn at least so often


def test_more_live_orders_put_snapshots_further_apart(tmp_path: Path) -> None:
    snapshotter = Snapshotter(tmp_path, events_apart=10)
    fleet = fleet_at(200)
    some = next(iter(fleet.orders.values()))
    fleet.orders = {OrderId(f"{n}"): some for n in range(50)}
    snapshotter.save(fleet)
    assert not snapshotter.due(299)
    assert snapshotter.due(300)


def test_the_head_is_one_line_of_json(tmp_path: Path) -> None:
    line, body = save(tmp_path, fleet_at(200)).read_bytes().split(b"\n", 1)
    head = msgspec.json.decode(line)
    assert (head["position"], head["at_ms"]) == (200, EVENTS[199].at_ms)
    assert (head["state_version"], head["size"]) == (STATE_VERSION, len(body))


def test_a_restored_state_forgets_answers_in_the_order_it_got_them(tmp_path: Path) -> None:
    def answered(position: int) -> AnyEvent:
        command = CommandId(f"key-{position * 7919 % 10_007}")  # not in alphabetical order
        return CommandAnswered(
            position=position, scene=SceneId("s"), command=command, digest="", status=200, body=""
        )

    count = AnswersWindow().count_max
    fleet = fold(Fleet(), map(answered, range(1, count + 1)))
    loaded = load(save(tmp_path, fleet))
    late = [answered(n) for n in range(count + 1, count + 4)]
    assert fold(loaded, late).canonical() == fold(fleet, late).canonical()


def damaged(raw: bytes) -> list[bytes]:
    head, body = raw.split(b"\n", 1)
    other_version = head.replace(b'"state_version":', b'"state_version":9')
    other_shape = head.replace(b'"shape":"', b'"shape":"0')
    return [
        b"",
        raw[:40],
        raw[:-1],
        raw[:-30] + bytes([raw[-30] ^ 1]) + raw[-29:],
        b"{}\n" + body,
        other_version + b"\n" + body,
        other_shape + b"\n" + body,
        head.replace(b"fleetledger-snapshot-1", b"fleetledger-snapshot-2") + b"\n" + body,
    ]


@pytest.mark.parametrize("case", range(8))
def test_an_unusable_snapshot_is_passed_over(tmp_path: Path, case: int) -> None:
    ledger, snapshots = tmp_path / "ledger", tmp_path / "snapshots"
    written(ledger, in_threes(EVENTS))
    save(snapshots, fleet_at(100))
    path = save(snapshots, fleet_at(200))
    path.write_bytes(damaged(path.read_bytes())[case])
    with pytest.raises(Unusable):
        load(path)
    assert nearest(snapshots).position == 100
    assert nearest(snapshots, at_ms=EVENTS[250].at_ms).position == 100
    assert to_bytes(restore(ledger, snapshots)) == to_bytes(fleet_at(300))
    assert to_bytes(restore(ledger, snapshots, position=250)) == to_bytes(fleet_at(250))


def test_a_snapshot_ahead_of_the_ledger_is_passed_over(tmp_path: Path) -> None:
    ledger, snapshots = tmp_path / "ledger", tmp_path / "snapshots"
    written(ledger, in_threes(EVENTS[:60]))
    save(snapshots, fleet_at(100))
    assert to_bytes(restore(ledger, snapshots)) == to_bytes(fleet_at(60))


def test_the_nearest_snapshot_at_or_before_a_moment_is_used(tmp_path: Path) -> None:
    for position in (50, 100, 150):
        save(tmp_path, fleet_at(position))
    found = {p: nearest(tmp_path, position=p).position for p in (0, 49, 50, 99, 100, 149, 999)}
    assert found == {0: 0, 49: 0, 50: 50, 99: 50, 100: 100, 149: 100, 999: 150}
    at_ms = EVENTS[99].at_ms
    assert nearest(tmp_path, at_ms=at_ms).position in (100, 150)
    assert nearest(tmp_path, at_ms=at_ms - 1).position == 50


def test_a_moment_before_everything_is_empty(tmp_path: Path) -> None:
    written(tmp_path / "ledger", in_threes(EVENTS[:60]))
    empty = Path(tmp_path / "none")
    assert restore(tmp_path / "ledger", empty, at_ms=EVENTS[0].at_ms - 1) == Fleet()
    assert restore(tmp_path / "ledger", empty, position=0) == Fleet()


def test_an_open_ledger_restores_through_its_own_reader(tmp_path: Path) -> None:
    save(tmp_path, fleet_at(100))
    ledgers = FileLedger.open(tmp_path / "ledger"), MemoryLedger()
    for ledger in ledgers:
        ledger.append(EVENTS, 0)
        assert ledger.wait(300, 30)
        fleet = restore(tmp_path / "nowhere", tmp_path, position=170, read=ledger.read)
        assert to_bytes(fleet) == to_bytes(fleet_at(170))
        ledger.close()


def test_old_snapshots_thin_out_and_the_newest_stays(tmp_path: Path) -> None:
    fleet = Fleet()
    for position in range(10, 1010, 10):
        fleet.position = position
        save(tmp_path, fleet, kept_max=8)
    kept = [int(path.stem) for path in snapshot_paths(tmp_path)]
    assert len(kept) == 8
    assert kept[-1] == 1000
    gaps = [b - a for a, b in zip([0, *kept], kept, strict=False)]
    assert max(gaps[:-1]) <= 300, "no stretch of the past is left without one"


def test_a_snapshot_is_due_after_enough_events(tmp_path: Path) -> None:
    snapshotter = Snapshotter(tmp_path, events_apart=100)
    assert not snapshotter.due(99)
    assert snapshotter.due(100)
    snapshotter.save(fleet_at(120))
    assert not snapshotter.due(219)
    assert snapshotter.due(220)
    assert not Snapshotter(tmp_path, events_apart=100).due(219)


def test_a_draft_left_by_a_crash_is_in_nobodys_way(tmp_path: Path) -> None:
    (tmp_path / "00000000000000000050.snapshot.tmp").write_bytes(b"half")
    save(tmp_path, fleet_at(50))
    assert [path.stem for path in snapshot_paths(tmp_path)] == [f"{50:020}"]
