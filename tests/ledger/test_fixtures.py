"""Ledgers of every release are read for ever, and those of newer programs are refused in words."""

import subprocess
import sys
from enum import StrEnum
from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

from fleetledger.cli import app
from ledger import segment
from ledger.codec import schema_of
from ledger.disk import Disk
from ledger.errors import LedgerDamaged, LedgerError, LedgerNewer
from ledger.events import EVENTS, AnyEvent, Event, OrderSealed, RobotAdded
from ledger.evolve import fold
from ledger.ids import OrderId, SceneId
from ledger.scan import read_folder
from ledger.seal import seal_folder
from ledger.snapshot import restore
from ledger.state import Fleet
from ledger.store import FileLedger
from tests.histories import history
from tests.ledger import fixtures
from tests.ledger.folders import written

NAMES = [one.name for one in fixtures.kept()]
# what states once held and nobody keeps any more
RETIRED = {"gateway_secret"}
MORE = 3


def says_all(old: Any, new: Any, where: str = "state") -> None:
    """Today's state says all that an old one said; it may say more."""
    if isinstance(old, dict):
        for key, value in old.items():
            if key not in RETIRED:
                assert key in new, f"{where}.{key}"
                says_all(value, new[key], f"{where}.{key}")
    elif isinstance(old, list):
        assert len(old) == len(new), where
        for number, (one, other) in enumerate(zip(old, new, strict=True)):
            says_all(one, other, f"{where}[{number}]")
    else:
        assert old == new, where


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def data(name: str, tmp_path: Path) -> Path:
    return fixtures.unpacked(name, tmp_path / "data")


def test_an_old_ledger_leads_to_the_state_that_its_program_had(name: str, data: Path) -> None:
    fleet = fold(Fleet(), read_folder(data / "ledger"))
    says_all(msgspec.json.decode(fixtures.state_then(name)), msgspec.json.decode(fleet.canonical()))
    (kept,) = (one for one in fixtures.kept() if one.name == name)
    assert fleet.position == kept.position


def test_todays_shapes_are_kept() -> None:
    newest = fixtures.kept()[-1]
    assert newest.vocabulary == fixtures.vocabulary(), (
        "events have changed: keep a ledger of the new shape. Where the newest fixture is of no "
        f"release yet, write it anew: python -m tests.ledger.fixtures {newest.name}; else give it "
        "the next number. docs/changing-events.md has the whole way."
    )
    kinds = {type(event) for event in fixtures.story()}
    assert kinds == set(EVENTS), "put the new event into the story of tests/ledger/fixtures.py"


def test_the_newest_ledger_gives_the_very_bytes(tmp_path: Path) -> None:
    newest = fixtures.kept()[-1].name
    folder = fixtures.unpacked(newest, tmp_path / "data")
    assert fold(Fleet(), read_folder(folder / "ledger")).canonical() == fixtures.state_then(newest)


def test_snapshots_of_another_shape_are_passed_over(data: Path) -> None:
    cold = fold(Fleet(), read_folder(data / "ledger"))
    assert restore(data / "ledger", data / "snapshots").canonical() == cold.canonical()


def test_an_old_ledger_is_sound_can_be_sealed_and_goes_on(data: Path) -> None:
    ledger = FileLedger.open(data / "ledger")
    before = list(ledger.read(0))
    new = [
        msgspec.structs.replace(event, position=len(before) + n, at_ms=before[-1].at_ms)
        for n, event in enumerate(history(1, MORE), 1)
    ]
    assert ledger.wait(ledger.append(new, len(before)), 30)
    ledger.close()
    assert list(seal_folder(Disk(), data / "ledger"))
    assert list(read_folder(data / "ledger")) == before + new
    checked = CliRunner().invoke(app, ["verify", str(data)])
    assert (checked.exit_code, "sound" in checked.output) == (0, True), checked.output


def test_an_old_ledger_can_be_asked(name: str, data: Path) -> None:
    done = CliRunner().invoke(app, ["replay", str(data), "--at", "2030-01-01", "--json"])
    assert done.exit_code == 0, done.output
    says_all(msgspec.json.decode(fixtures.state_then(name)), msgspec.json.decode(done.stdout))
    asked = ["sql", str(data), "SELECT count(*) AS n FROM orders", "--format", "json"]
    answered = CliRunner().invoke(app, asked)
    assert answered.exit_code == 0, answered.output


def test_the_secret_of_a_gateway_that_an_old_ledger_holds_is_not_read(tmp_path: Path) -> None:
    folder = fixtures.unpacked("1-orders", tmp_path / "data")
    raw = b"".join(path.read_bytes() for path in sorted((folder / "ledger").iterdir()))
    assert b"a secret of old" in raw
    assert any(isinstance(event, RobotAdded) for event in read_folder(folder / "ledger"))
    assert b"a secret of old" not in fold(Fleet(), read_folder(folder / "ledger")).canonical()


class RobotDanced(Event, frozen=True, kw_only=True):
    """A word of tomorrow."""


class OrderSealedTomorrow(OrderSealed, frozen=True, kw_only=True, tag="OrderSealed"):
    """Another field."""

    seal: str = "wax"


class RoleTomorrow(StrEnum):
    VIEWER = "viewer"
    OWNER = "owner"


class UserAddedTomorrow(Event, frozen=True, kw_only=True, tag="UserAdded"):
    """Another value of an enumeration."""

    user: str
    role: RoleTomorrow


SCENE = SceneId("s")
TOMORROW = {
    "RobotDanced is an unknown type of event": RobotDanced(scene=SCENE),
    "OrderSealed has unknown seal": OrderSealedTomorrow(scene=SCENE, order=OrderId("o")),
    "Role has unknown owner": UserAddedTomorrow(scene=SCENE, user="u", role=RoleTomorrow.OWNER),
}


def tomorrow(monkeypatch: pytest.MonkeyPatch, directory: Path, event: Any) -> None:
    """Write a ledger as a newer program does: an unknown event, and then known ones."""
    kind = type(event)
    name = kind.__name__.removesuffix("Tomorrow")
    schema = schema_of(kind).replace(b"Tomorrow", b"")
    declaration = segment.mcap.schema(900, name, "jsonschema", schema)
    declaration += segment.mcap.channel(900, 900, f"x/{name}", "json")
    known = segment._Channel(number=900, declaration=declaration)
    monkeypatch.setitem(segment._CHANNELS, kind, known)
    events: list[AnyEvent] = history(2, 40)
    stamped = msgspec.structs.replace(event, position=1, at_ms=events[0].at_ms)
    rest = [msgspec.structs.replace(e, position=e.position + 1) for e in events]
    written(directory, [[stamped], *([e] for e in rest)])


@pytest.mark.parametrize("words", TOMORROW)
def test_what_a_newer_program_wrote_is_refused_by_name(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tomorrow(monkeypatch, tmp_path / "ledger", TOMORROW[words])
    with pytest.raises(LedgerNewer, match=words) as refused:
        list(read_folder(tmp_path / "ledger"))
    assert "at least as new" in refused.value.hint
    with pytest.raises(LedgerNewer, match=words):  # also for whoever begins behind it
        list(read_folder(tmp_path / "ledger", after=30))
    checked = CliRunner().invoke(app, ["verify", str(tmp_path)])
    said = " ".join(checked.output.split())
    assert checked.exit_code == 1
    assert words in said
    assert "at least as new" in said


def test_a_server_refuses_a_newer_ledger_and_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words, event = next(iter(TOMORROW.items()))
    tomorrow(monkeypatch, tmp_path / "ledger", event)
    command = [sys.executable, "-m", "fleetledger", "serve", "--data", str(tmp_path), "--port", "0"]
    served = subprocess.run(command, capture_output=True, text=True, timeout=60)
    said = " ".join(served.stderr.split())
    assert (served.returncode, served.stdout) == (2, "")
    assert words in said
    assert "at least as new" in said


def test_a_format_of_tomorrow_is_not_called_damage_alone(tmp_path: Path) -> None:
    written(tmp_path / "ledger", [history(2, 40)])
    (path,) = (tmp_path / "ledger").glob("*.mcap")
    raw = path.read_bytes()
    path.write_bytes(raw.replace(b"fleetledger-1", b"fleetledger-2"))
    with pytest.raises(LedgerDamaged, match="says fleetledger-2, as a newer program might"):
        list(read_folder(tmp_path / "ledger"))
    with pytest.raises(LedgerError, match="says fleetledger-2, as a newer program might") as no:
        FileLedger.open(tmp_path / "ledger")
    assert "at least as new" in no.value.hint


def test_a_snapshot_of_tomorrow_is_passed_over(tmp_path: Path) -> None:
    folder = fixtures.unpacked(NAMES[-1], tmp_path / "data")
    cold = fold(Fleet(), read_folder(folder / "ledger")).canonical()
    (path,) = (folder / "snapshots").iterdir()
    raw = path.read_bytes()
    for old, new in (
        (b"fleetledger-snapshot-1", b"fleetledger-snapshot-2"),
        (b'"size"', b'"sigh"'),
    ):
        path.write_bytes(raw.replace(old, new, 1))
        assert restore(folder / "ledger", folder / "snapshots").canonical() == cold


def test_kept_ledgers_are_small(name: str) -> None:
    assert sum(path.stat().st_size for path in (fixtures.FOLDER / name).iterdir()) < 100_000
