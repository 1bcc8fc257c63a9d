"""Sealing as an operator meets it: in the background, and a damaged folder that is refused."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fleetledger.sealer_role import FAILED
from ledger.codec import encode
from ledger.disk import Disk
from ledger.lock import Lock
from ledger.scan import read_folder
from ledger.seal import LOCK_NAME, seal, unsealed
from ledger.segment import segment_name
from ledger.store import FileLedger
from ledger.verify import verify
from tests.fleetledger.server import EVENT_S_MAX, command, serving
from tests.histories import history
from tests.ledger.folders import in_threes, written

EVENTS = history(61, 90)


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder of five segments, none of them sealed."""
    data = tmp_path_factory.mktemp("plant")
    written(data / "ledger", in_threes(EVENTS), segment_chunks_max=6)
    assert len(unsealed(data / "ledger")) == 4
    return data


@pytest.fixture
def data(plant: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(plant, tmp_path / "data"))


WIDE = {**os.environ, "COLUMNS": "1000"}  # so that no line is broken


def program(*command_line: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command_line,
        capture_output=True,
        text=True,
        timeout=EVENT_S_MAX,
        check=False,
        env=WIDE,
    )


def test_a_server_seals_what_is_finished_and_goes_on(data: Path) -> None:
    with serving(data, "--auth", "none") as server:
        deadline = time.monotonic() + EVENT_S_MAX
        while unsealed(data / "ledger")[:4]:
            assert server.get("/api/ping") is not None
            assert time.monotonic() < deadline, "nothing was sealed"
        page = server.get("/api/ledger/events", after=0, limit=90)
        assert [event["position"] for event in page] == list(range(1, 91))
        metrics = server.client.get("/metrics").text
        assert "fleetledger_sealing_failures_total 0.0" in metrics
        server.kill()
    assert "segment sealed" in server.log.read_text()
    verdict = verify(data)
    assert verdict.sound and verdict.sealed >= 4
    assert [encode(e) for e in read_folder(data / "ledger", 0, 90)] == [encode(e) for e in EVENTS]


SEALER = (sys.executable, "-m", "fleetledger", "role", "sealer", "--data")


def sealer(data: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*SEALER, str(data)],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_the_sealer_ends_when_all_is_sealed(data: Path) -> None:
    process = sealer(data)
    _, errors = process.communicate(timeout=EVENT_S_MAX)
    # communicate closes standard input, upon which it may have ended before
    assert process.returncode == 0, errors
    assert verify(data).sound
    assert not list((data / "ledger").glob("*.tmp"))


def test_one_damaged_segment_does_not_keep_the_others_from_being_sealed(data: Path) -> None:
    path = data / "ledger" / segment_name(19)
    wrong = bytearray(path.read_bytes())
    wrong[700] ^= 1
    path.write_bytes(wrong)
    process = sealer(data)
    assert process.wait(EVENT_S_MAX) == FAILED
    assert process.stdin is not None and process.stderr is not None
    errors = process.stderr.read()
    process.stdin.close()
    process.stderr.close()
    assert "restore this file from a backup" in errors
    assert path.read_bytes() == wrong
    assert [p.name for p in unsealed(data / "ledger")] == [path.name]


def test_a_second_sealer_leaves_the_folder_to_the_first(data: Path) -> None:
    lock = Lock(data / "ledger", LOCK_NAME)
    done = program(*SEALER, str(data))
    lock.close()
    assert done.returncode == 2 and "LedgerLocked" in done.stderr
    assert len(unsealed(data / "ledger")) == 4


def test_a_sealer_that_is_killed_leaves_a_sound_folder(data: Path) -> None:
    process = sealer(data)
    assert process.stderr is not None
    assert "segment sealed" in process.stderr.readline()
    process.kill()
    process.communicate()
    FileLedger.open(data / "ledger").close()
    assert not list((data / "ledger").glob("*.tmp"))
    verdict = verify(data)
    assert verdict.sound and verdict.sealed >= 1
    assert list(read_folder(data / "ledger")) == EVENTS


def test_a_server_refuses_damage_with_the_words_of_verify(data: Path) -> None:
    path = data / "ledger" / segment_name(19)
    assert seal(Disk(), path) is not None
    wrong = bytearray(path.read_bytes())
    wrong[len(wrong) // 3] ^= 4
    path.write_bytes(wrong)
    refused = program(*command(data, "--auth", "none"))
    found = program(sys.executable, "-m", "fleetledger", "verify", str(data))
    assert (refused.returncode, found.returncode) == (2, 1)
    said, advice, *_ = found.stdout.splitlines()
    assert said.startswith(f"{path}, byte ") and ", position " in said
    assert refused.stderr.splitlines()[-2:] == [f"LedgerDamaged: {said}", advice.strip()]
    assert "restore this file from a backup" in advice
