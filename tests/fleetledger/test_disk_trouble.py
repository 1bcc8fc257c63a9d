"""Disks that are full, failing, read-only or not ours: what is said, and what goes on."""

import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from time import monotonic
from typing import Any

import httpx
import pytest

from tests.fleetledger.mounts import (
    fill,
    limit_files,
    on_small_disk,
    read_only,
    seen_by,
    without_privileges,
)
from tests.fleetledger.server import (
    EVENT_S_MAX,
    START_S_MAX,
    Server,
    command,
    order_body,
    serving,
    small_file,
    small_scene,
    started,
    still_there,
)
from tests.laws.onlooker import bins_of

OPEN = ("--auth", "none")
CREATE = "/api/fleet/orders/create"
BINS = bins_of(small_file())
MB = 1_000_000
SIGNED: dict[str, Any] = {
    "enableOrderCallback": True,
    "callbackUrlList": ["http://127.0.0.1:9/"],
    "secret": "s" * 40,
}


def refused(command_line: list[str]) -> str:
    """Start a server that must not start; gives what it says, in one line."""
    done = subprocess.run(
        command_line, capture_output=True, text=True, timeout=START_S_MAX, check=False
    )
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    said = " ".join(done.stderr.split())
    assert len(done.stderr) < 1000, "not one clear message"
    return said


def said_offline(command_line: list[str]) -> tuple[int, str]:
    done = subprocess.run(
        command_line, capture_output=True, text=True, timeout=START_S_MAX, check=False
    )
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder that a server has left in order."""
    made = tmp_path_factory.mktemp("left")
    with serving(made / "data", *OPEN, "--scene", str(small_scene(made))) as server:
        server.order(BINS[0], BINS[-1])
        assert server.stop() == 0
    return made / "data"


def test_a_read_only_folder_is_not_served_but_can_be_read(folder: Path) -> None:
    before = sorted((path, path.stat().st_mtime_ns) for path in folder.rglob("*"))
    said = refused(read_only(folder, command(folder, *OPEN)))
    assert "DiskTrouble" in said and f"{folder} cannot be used: Read-only file system." in said
    assert "mounted read-only" in said and "start again" in said
    program = [sys.executable, "-m", "fleetledger"]
    sql = "SELECT count(*) AS n FROM orders"
    for arguments, wanted in (
        (["verify", str(folder)], "sound: "),
        (["replay", str(folder), "--at", "2100-01-01", "--json"], '"orders":{"TO'),
        (["sql", str(folder), sql, "--format", "json"], '[{"n":1}]'),
    ):
        code, said = said_offline(read_only(folder, [*program, *arguments]))
        assert (code, wanted in said) == (0, True), said
    assert sorted((path, path.stat().st_mtime_ns) for path in folder.rglob("*")) == before


def test_what_others_own_is_named(folder: Path) -> None:
    folder.chmod(0o555)
    said = refused(without_privileges(command(folder, *OPEN)))
    assert f"{folder} cannot be used: Permission denied." in said
    assert "the right to read and write it" in said
    folder.chmod(0o755)
    for name in ("ledger/00000000000000000001.mcap", "config.toml"):
        file = folder / name
        file.touch()
        file.chmod(0o000)
        said = refused(without_privileges(command(folder, *OPEN)))
        assert str(file) in said and "Permission denied" in said, said
        assert "the right to read and write it" in said
        file.chmod(0o644)
    (folder / "config.toml").unlink()


def test_a_file_is_no_folder_and_a_full_disk_no_place(tmp_path: Path) -> None:
    file = tmp_path / "data"
    file.write_text("something else")
    said = refused(command(file, *OPEN))
    assert f"{file} cannot be used: File exists." in said
    assert "name another folder" in said
    small = tmp_path / "small"
    small.mkdir()
    said = refused(on_small_disk(20, small, command(small, *OPEN)))
    assert "DiskFull" in said and "64 MB must stay free" in said
    assert "Free space on that disk" in said


def test_a_lost_ledger_is_not_begun_anew_in_silence(folder: Path) -> None:
    ledger, aside = folder / "ledger", folder / "aside"
    ledger.rename(aside)
    try:
        said = refused(command(folder, *OPEN))
        assert "LedgerLost" in said and str(ledger) in said
        assert "Restore the ledger from a backup" in said
        assert not ledger.exists(), "nothing was made"
        for snapshot in (folder / "snapshots").iterdir():
            snapshot.rename(folder / snapshot.name)
        assert "history.duckdb" in refused(command(folder, *OPEN)), "the history knows as well"
    finally:
        aside.rename(ledger)


class Clients:
    """Threads that send orders until one is not taken; they keep what was acknowledged."""

    def __init__(self, server: Server) -> None:
        self.acknowledged: dict[str, str] = {}  # Idempotency-Key -> order
        self.refusals: list[httpx.Response] = []
        self._url, self._scene = server.url, server.scene
        threads = [threading.Thread(target=self._send, args=(n,)) for n in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(EVENT_S_MAX)

    def _send(self, client: int) -> None:
        with httpx.Client(base_url=self._url, timeout=30) as http:
            for number in count():
                key = f"{client}-{number}"
                answer = asked(http, self._scene, key)
                if answer.status_code != 200:
                    self.refusals.append(answer)
                    return
                self.acknowledged[key] = answer.json()["orderId"]


def asked(http: httpx.Client, scene: str, key: str) -> httpx.Response:
    body = order_body(scene, BINS[0], BINS[-1])
    return http.post(CREATE, json=body, headers={"Idempotency-Key": key})


def figure(server: Server, name: str) -> float:
    found = re.search(rf"^{name}(?:{{.*}})? (\S+)$", server.client.get("/metrics").text, re.M)
    assert found is not None, name
    return float(found[1])


def newest_segment(data: Path) -> int:
    return max((data / "ledger").glob("*.mcap")).stat().st_size


def test_a_failed_write_ends_the_server_after_a_grace_and_loses_nothing(tmp_path: Path) -> None:
    data, scene_file = tmp_path / "data", small_scene(tmp_path)
    data.mkdir()
    (data / "config.toml").write_text("failure_grace_s = 4\n")
    with serving(data, *OPEN, "--simulate", "--scene", str(scene_file)) as server:
        scene = server.scene
        limit_files(server.process.pid, newest_segment(data) + 40_000)
        clients = Clients(server)
        assert clients.acknowledged and clients.refusals
        for refusal in clients.refusals:
            assert refusal.status_code == 503
            assert refusal.json()["code"] == "errLedgerUnavailable"
            assert "File too large. Raise the limit on the size of files" in refusal.text
        _queries_go_on(server, scene, set(clients.acknowledged.values()))
        assert server.process.wait(EVENT_S_MAX) == 3
        assert still_there(server.children) == []
        log = server.log.read_text()
    assert log.count("ledger failed; commands are refused") == 1
    assert "Traceback" not in log
    assert log.count("proposals are not taken") <= 1
    assert said_offline([sys.executable, "-m", "fleetledger", "verify", str(data)])[0] == 0
    (data / "config.toml").write_text("failure_grace_s = 600\n")
    with serving(data, *OPEN) as server:
        for key, order in clients.acknowledged.items():
            assert asked(server.client, scene, key).json()["orderId"] == order
        kept = server.found().values()
        asked_for = [row for row in kept if row["kind"] == "Business"]
        assert len(asked_for) <= len(clients.acknowledged) + len(clients.refusals)
        server.order(BINS[0], BINS[-1])  # makes the segment that is written now
        limit_files(server.process.pid, newest_segment(data) + 100)
        assert asked(server.client, scene, "late").status_code == 503
        again = asked(server.client, scene, next(iter(clients.acknowledged)))
        assert again.status_code == 200, "an answer that is on disk"
        began = monotonic()
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(EVENT_S_MAX) == 3
        assert monotonic() - began < 600, "a signal ends the grace"


def _queries_go_on(server: Server, scene: str, acknowledged: set[str]) -> None:
    assert acknowledged <= server.found().keys()
    assert server.get("/api/ping")["id"] == "anonymous"
    assert figure(server, "fleetledger_ledger_accepting") == 0
    events = server.get("/api/ledger/events", limit=10_000)
    assert acknowledged <= {event["order"] for event in events if event["type"] == "OrderCreated"}
    assert server.client.get(f"/api/fleet/scenes/{scene}/config").status_code == 200
    assert len(server.get("/api/fleet/robots/all-all", sceneId=scene)) == 3


def test_a_secret_that_cannot_be_written_is_not_in_force(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with serving(data, *OPEN, "--scene", str(small_scene(tmp_path))) as server:
        callbacks = f"/api/fleet/scenes/{server.scene}/callbacks"
        in_the_way = data / "secrets.json.lock"
        in_the_way.mkdir()
        answer = server.client.post(callbacks, json=SIGNED)
        assert (answer.status_code, answer.json()["code"]) == (503, "errNotWritten")
        assert "secrets.json cannot be written: Is a directory" in answer.text
        found = server.get(callbacks)
        assert (found["enableOrderCallback"], "secret" in found) == (False, False)
        in_the_way.rmdir()
        assert server.post(callbacks, SIGNED)["enableOrderCallback"]
        assert server.stop() == 0


@pytest.fixture
def cramped(tmp_path: Path) -> Iterator[tuple[Server, Path]]:
    """A server on a disk of 150 MB, of which 40 MB are to stay free, and the disk as seen here."""
    data = tmp_path / "data"
    data.mkdir()
    scene = small_scene(tmp_path)
    serve = command(data, *OPEN, "--simulate", "--speed", "10", "--scene", str(scene))
    serve = ["env", "FLEETLEDGER_DISK_RESERVE_MB=40", *serve]
    with started(on_small_disk(150, data, serve), data) as server:
        yield server, seen_by(server.process.pid, data)


def until_accepting(server: Server, wanted: float) -> None:
    deadline = monotonic() + EVENT_S_MAX
    while figure(server, "fleetledger_ledger_accepting") != wanted:
        assert monotonic() < deadline


def test_a_full_disk_holds_commands_up_until_there_is_room(cramped: tuple[Server, Path]) -> None:
    server, disk = cramped
    scene = server.scene
    orders = [server.order(BINS[n], BINS[-1 - n]) for n in range(3)]
    server.until(lambda event: event["type"] == "StepStarted")
    filler = fill(disk, 20 * MB)
    until_accepting(server, 0)
    answer = asked(server.client, scene, "low")
    assert (answer.status_code, answer.json()["code"]) == (503, "errDiskFull"), answer.text
    assert "40 MB must stay free" in answer.text and "by itself" in answer.text
    assert answer.headers["Retry-After"]
    fill(disk, 0)  # to the last byte
    callbacks = f"/api/fleet/scenes/{scene}/callbacks"
    answer = server.client.post(callbacks, json=SIGNED)
    assert (answer.status_code, answer.json()["code"]) == (503, "errDiskFull"), answer.text
    assert "secret" not in server.get(callbacks), "what is refused leaves it alone"
    assert set(orders) <= server.found().keys()
    assert server.get("/api/fleet/robots/all-all", sceneId=scene)
    filler.unlink()
    until_accepting(server, 1)
    assert asked(server.client, scene, "low").status_code == 200, "the key was not used up"
    for order in orders:
        server.until_finished(order)
    assert {server.found(order)[order]["status"] for order in orders} == {"Done"}
    assert "fleetledger_child_restarts_total{" not in server.client.get("/metrics").text
    verify = [sys.executable, "-m", "fleetledger", "verify", str(disk)]
    assert said_offline(verify)[0] == 0
    server.client.close()
    server.process.send_signal(signal.SIGTERM)
    assert server.process.wait(EVENT_S_MAX) == 0
    log = server.log.read_text()
    assert log.count("commands are refused") == log.count("commands are taken again") == 1
    assert log.count("proposals are not taken") <= 1
    assert "Traceback" not in log
