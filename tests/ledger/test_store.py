import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from ledger import store
from ledger.errors import Conflict, LedgerBusy, LedgerError, LedgerLocked, Unknown
from ledger.events import AnyEvent, RobotConnected, RobotDisconnected
from ledger.ids import CommandId, RobotName, SceneId
from ledger.scan import read_folder
from ledger.store import FileLedger, MemoryLedger
from tests.histories import history
from tests.ledger.disks import FailingDisk, GatedDisk, ShortDisk
from tests.ledger.folders import commit_each, in_threes, written

EVENTS = history(7, 240)
S, R = SceneId("s"), RobotName("r")


def connected(position: int, command: str = "") -> RobotConnected:
    return RobotConnected(
        position=position, at_ms=position, scene=S, robot=R, command=CommandId(command)
    )


@pytest.fixture(params=["file", "memory"])
def ledger(request: pytest.FixtureRequest, tmp_path: Path) -> FileLedger | MemoryLedger:
    ledger = FileLedger.open(tmp_path / "ledger") if request.param == "file" else MemoryLedger()
    request.addfinalizer(ledger.close)
    return ledger


def test_what_is_appended_is_read_back(ledger: FileLedger | MemoryLedger) -> None:
    assert list(ledger.read(0)) == []
    assert ledger.append(EVENTS[:5], 0) == 5
    assert ledger.append((), 5) == 5
    assert ledger.append(EVENTS[5:9], 5) == 9
    assert ledger.wait(9, 30)
    assert (ledger.position, ledger.durable) == (9, 9)
    assert list(ledger.read(0)) == EVENTS[:9]
    assert list(ledger.read(4, 7)) == EVENTS[4:7]
    assert list(ledger.read(9)) == []
    assert list(ledger.read(99)) == []


def test_an_append_on_an_older_position_is_a_conflict(ledger: FileLedger | MemoryLedger) -> None:
    ledger.append(EVENTS[:5], 0)
    with pytest.raises(Conflict) as caught:
        ledger.append(EVENTS[3:4], 3)
    assert (caught.value.expected, caught.value.actual) == (3, 5)


def test_events_out_of_place_are_a_bug(ledger: FileLedger | MemoryLedger) -> None:
    with pytest.raises(ValueError, match="due at 1 is stamped 2"):
        ledger.append(EVENTS[1:2], 0)
    with pytest.raises(ValueError, match="at_ms -1"):
        ledger.append([RobotConnected(position=1, at_ms=-1, scene=S, robot=R)], 0)
    assert ledger.position == 0


def test_listeners_hear_everything_once_and_in_order(ledger: FileLedger | MemoryLedger) -> None:
    heard: list[AnyEvent] = []
    durable: list[bool] = []

    def listener(events: Sequence[AnyEvent]) -> None:
        heard.extend(events)
        durable.append(ledger.durable >= events[-1].position)

    ledger.listen(listener)
    for events in in_threes(EVENTS):
        ledger.append(events, ledger.position)
    assert ledger.wait(len(EVENTS), 30)
    assert heard == EVENTS
    assert all(durable)


def test_a_ledger_goes_on_where_it_ended(tmp_path: Path) -> None:
    for n in range(0, len(EVENTS), 60):
        ledger = FileLedger.open(tmp_path)
        assert (ledger.position, ledger.durable) == (n, n)
        commit_each(ledger, in_threes(EVENTS[n : n + 60]))
        ledger.close()
    assert list(read_folder(tmp_path)) == EVENTS
    assert len(list(tmp_path.glob("*.mcap"))) == 4


def test_opening_and_closing_makes_no_files(tmp_path: Path) -> None:
    written(tmp_path, [EVENTS[:5]])
    before = sorted(path.name for path in tmp_path.iterdir())
    FileLedger.open(tmp_path).close()
    assert sorted(path.name for path in tmp_path.iterdir()) == before


@pytest.mark.parametrize("options", [{"segment_chunks_max": 7}, {"segment_bytes_max": 30_000}])
def test_segments_roll_and_reading_crosses_them(tmp_path: Path, options: dict[str, int]) -> None:
    ledger = FileLedger.open(tmp_path, **options)
    commit_each(ledger, in_threes(EVENTS))
    assert len(list(tmp_path.glob("*.mcap"))) > 3
    for after, until in ((0, 240), (0, 0), (1, 2), (20, 21), (21, 22), (100, 239), (239, 240)):
        assert list(ledger.read(after, until)) == EVENTS[after:until]
        assert list(read_folder(tmp_path, after, until)) == EVENTS[after:until]
    for after in range(0, 240, 7):
        assert list(ledger.read(after)) == EVENTS[after:]
        assert list(read_folder(tmp_path, after)) == EVENTS[after:]
    ledger.close()


def chunks(path: Path) -> list[Chunk]:
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True).records
        return [record for record in records if isinstance(record, Chunk)]


def events_by_chunk(folder: Path) -> list[int]:
    (path,) = folder.glob("*.mcap")
    return [chunk.data.count(b'{"type":"RobotConnected"') for chunk in chunks(path)]


def test_commands_that_wait_for_the_disk_share_one_sync(tmp_path: Path) -> None:
    disk = GatedDisk()
    disk.gate.set()
    ledger = FileLedger.open(tmp_path, disk=disk)
    commit_each(ledger, [EVENTS[:3]])
    disk.gate.clear()
    disk.waiting.clear()
    ledger.append(EVENTS[3:6], 3)
    assert disk.waiting.wait(30)
    syncs = disk.syncs
    for n in range(6, 96, 3):
        ledger.append(EVENTS[n : n + 3], n)
    assert ledger.durable == 3
    assert list(ledger.read(0)) == EVENTS[:3], "only what is on disk is read"
    assert not ledger.wait(96, 0.0)
    disk.gate.set()
    assert ledger.wait(96, 30)
    assert disk.syncs == syncs + 1
    ledger.close()
    assert len(chunks(max(tmp_path.glob("*.mcap")))) == 3


def test_what_comes_before_the_committer_is_roused_is_one_commit(tmp_path: Path) -> None:
    ledger = FileLedger.open(tmp_path)
    wakes: list[Callable[[], None]] = []
    commits: list[Sequence[AnyEvent]] = []
    ledger.rouse_by(wakes.append)
    ledger.listen(commits.append)
    for n in range(0, 9, 3):
        ledger.append(EVENTS[n : n + 3], n)
    assert len(wakes) == 1
    wakes[0]()
    assert ledger.wait(9, 30)
    assert [list(commit) for commit in commits] == [EVENTS[:9]]
    ledger.append(EVENTS[9:12], 9)
    assert len(wakes) == 2
    ledger.close()  # which needs nobody to rouse it
    assert ledger.durable == 12


def test_a_command_never_spans_two_chunks(tmp_path: Path) -> None:
    disk = GatedDisk()
    disk.gate.set()
    ledger = FileLedger.open(tmp_path, disk=disk)
    commit_each(ledger, [[connected(1)]])
    disk.gate.clear()
    disk.waiting.clear()
    ledger.append([connected(2)], 1)
    assert disk.waiting.wait(30)
    sizes = (400, 100, 13, 511, 2, 700, 1)
    for size in sizes:
        first = ledger.position + 1
        ledger.append([connected(first + n) for n in range(size)], first - 1)
    disk.gate.set()
    ledger.close()
    assert events_by_chunk(tmp_path) == [1, 1, 500, 13, 511, 2, 700, 1]


def test_a_chunk_takes_no_more_commands_once_it_is_a_megabyte(tmp_path: Path) -> None:
    disk = GatedDisk()
    disk.gate.set()
    ledger = FileLedger.open(tmp_path, disk=disk)
    commit_each(ledger, [[connected(1)]])
    disk.gate.clear()
    disk.waiting.clear()
    ledger.append([connected(2)], 1)
    assert disk.waiting.wait(30)
    for n in range(3, 13):
        ledger.append([connected(n, "x" * 300_000)], n - 1)
    disk.gate.set()
    ledger.close()
    assert events_by_chunk(tmp_path) == [1, 1, 4, 4, 2]


def test_too_long_a_queue_refuses_and_keeps_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "QUEUE_EVENTS_MAX", 10)
    disk = GatedDisk()
    disk.gate.set()
    ledger = FileLedger.open(tmp_path, disk=disk)
    commit_each(ledger, [EVENTS[:3]])
    disk.gate.clear()
    disk.waiting.clear()
    ledger.append(EVENTS[3:4], 3)
    assert disk.waiting.wait(30)
    ledger.append(EVENTS[4:24], 4)  # alone in the queue, however long
    with pytest.raises(LedgerBusy, match="20 events wait"):
        ledger.append(EVENTS[24:25], 24)
    assert ledger.position == 24
    disk.gate.set()
    assert ledger.wait(24, 30)
    assert ledger.append(EVENTS[24:25], 24) == 25
    ledger.close()
    assert list(read_folder(tmp_path)) == EVENTS[:25]


def test_a_disk_that_takes_little_at_once_gets_all_in_the_end(tmp_path: Path) -> None:
    ledger = FileLedger.open(tmp_path, disk=ShortDisk())
    commit_each(ledger, in_threes(EVENTS[:12]))
    ledger.close()
    assert list(read_folder(tmp_path)) == EVENTS[:12]


@pytest.mark.parametrize("what", ["write", "sync"])
@pytest.mark.parametrize("at", range(6))
def test_after_a_failure_nothing_is_accepted_or_tried_again(
    tmp_path: Path, what: str, at: int
) -> None:
    disk = FailingDisk(**{what: at})
    failures: list[LedgerError] = []
    ledger = FileLedger.open(tmp_path, disk=disk)
    ledger.on_failure(failures.append)
    acknowledged = 0
    with pytest.raises(Unknown):
        for events in in_threes(EVENTS):
            position = ledger.append(events, ledger.position)
            assert ledger.wait(position, 30)
            acknowledged = position
    assert ledger.durable == acknowledged
    with pytest.raises(Unknown):
        ledger.append(EVENTS[ledger.position : ledger.position + 1], ledger.position)
    with pytest.raises(Unknown):
        ledger.wait(len(EVENTS), 30)
    assert list(ledger.read(0)) == EVENTS[:acknowledged], "queries go on"
    ledger.close()
    assert [type(failure) for failure in failures] == [Unknown]
    assert disk.calls_after == []
    late: list[LedgerError] = []
    ledger.on_failure(late.append)
    assert late == failures

    again = FileLedger.open(tmp_path)
    assert acknowledged <= again.position <= acknowledged + 3
    kept = list(again.read(0))
    assert kept == EVENTS[: again.position]
    again.append(EVENTS[again.position : again.position + 3], again.position)
    again.close()
    assert list(read_folder(tmp_path)) == EVENTS[: again.position]


def test_a_listener_that_fails_stops_the_ledger(tmp_path: Path) -> None:
    def fails(events: Sequence[AnyEvent]) -> None:
        raise ValueError("cannot follow")

    ledger = FileLedger.open(tmp_path)
    ledger.listen(fails)
    with pytest.raises(Unknown, match="cannot follow"):
        ledger.wait(ledger.append(EVENTS[:3], 0), 30)
    ledger.close()


def test_a_closed_ledger_accepts_nothing(tmp_path: Path) -> None:
    ledger = FileLedger.open(tmp_path)
    ledger.append(EVENTS[:3], 0)
    ledger.close()
    ledger.close()
    with pytest.raises(Unknown, match="closed"):
        ledger.append(EVENTS[3:4], 3)
    assert list(read_folder(tmp_path)) == EVENTS[:3], "what was queued is on disk"


def test_two_servers_cannot_have_one_ledger(tmp_path: Path) -> None:
    ledger = FileLedger.open(tmp_path)
    with pytest.raises(LedgerLocked, match="in use by process"):
        FileLedger.open(tmp_path)
    ledger.close()
    FileLedger.open(tmp_path).close()


def test_many_threads_keep_one_dense_order(tmp_path: Path) -> None:
    ledger = FileLedger.open(tmp_path)
    done: list[tuple[str, int]] = []

    def client(name: str) -> None:
        for n in range(40):
            while True:
                expected = ledger.position
                a = connected(expected + 1, f"{name}-{n}")
                b = RobotDisconnected(
                    position=expected + 2, at_ms=a.at_ms, scene=S, robot=R, command=a.command
                )
                try:
                    position = ledger.append([a, b], expected)
                except Conflict:
                    continue
                break
            assert ledger.wait(position, 30)
            done.append((a.command, position))

    threads = [threading.Thread(target=client, args=(f"c{n}",)) for n in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    ledger.close()
    events = list(read_folder(tmp_path))
    assert [event.position for event in events] == list(range(1, 641))
    assert {(e.command, e.position) for e in events if isinstance(e, RobotDisconnected)} == set(
        done
    )
    for first, second in zip(events[::2], events[1::2], strict=True):
        assert first.command == second.command, "a command's events stay together"


def test_without_a_thread_a_commit_is_made_where_somebody_waits(tmp_path: Path) -> None:
    ledger = FileLedger.open(tmp_path, threaded=False)
    heard: list[int] = []
    ledger.listen(lambda events: heard.append(threading.get_ident()))
    for start in (0, 3, 6):
        ledger.append(EVENTS[start : start + 3], start)
    assert ledger.durable == 0
    assert ledger.wait(9, 0)
    assert not ledger.step()
    assert heard == [threading.get_ident()]
    ledger.append(EVENTS[9:12], 9)
    assert ledger.step()
    assert ledger.durable == 12
    ledger.append(EVENTS[12:15], 12)
    ledger.close()
    ledger.close()
    assert list(read_folder(tmp_path)) == EVENTS[:15]


def test_without_a_thread_a_failure_ends_it_just_so(tmp_path: Path) -> None:
    disk = FailingDisk(sync=1)  # the new segment's own one passes
    ledger = FileLedger.open(tmp_path, disk=disk, threaded=False)
    ledger.append(EVENTS[:3], 0)
    with pytest.raises(Unknown):
        ledger.wait(3, 0)
    assert not ledger.step()
    with pytest.raises(Unknown):
        ledger.append(EVENTS[:3], 0)
    ledger.close()
    assert disk.calls_after == []
    FileLedger.open(tmp_path).close()
