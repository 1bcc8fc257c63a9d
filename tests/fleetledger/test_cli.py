"""The command line: help that teaches, files in and out, and bad input in one line."""

import csv
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from commands.imports.scene_json import read_scene
from fleetledger.cli import app
from ledger.segment import SUFFIX
from tests.fleetledger.server import serving, small_file, small_scene
from tests.laws.onlooker import bins_of

COMMANDS = (
    (),
    ("demo",),
    ("serve",),
    ("scene",),
    ("scene", "import"),
    ("scene", "check"),
    ("scene", "generate"),
    ("verify",),
    ("replay",),
    ("export",),
    ("sql",),
)
SMAP = {
    "header": {"mapName": "hall"},
    "advancedPointList": [
        {"className": "LocationMark", "instanceName": "LM1", "pos": {}},
        {"className": "ActionPoint", "instanceName": "AP2", "pos": {"x": 3.0}},
    ],
    "advancedCurveList": [
        {
            "className": "StraightPath",
            "instanceName": f"{start}-{end}",
            "startPos": {"instanceName": start},
            "endPos": {"instanceName": end},
        }
        for start, end in (("LM1", "AP2"), ("AP2", "LM1"))
    ],
}
GRID = "type octile\nheight 2\nwidth 3\nmap\n...\n.@.\n"


def run(*arguments: object) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, [str(a) for a in arguments])


def good(*arguments: object) -> Result:
    done = run(*arguments)
    assert done.exit_code == 0, done.output
    return done


def bad(*arguments: object) -> str:
    """Refused as bad input, without a traceback; gives the words."""
    done = run(*arguments)
    assert done.exit_code == 2, (done.exit_code, done.output, done.exception)
    assert isinstance(done.exception, SystemExit)
    assert done.stdout == ""
    return " ".join(done.stderr.split())


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, int, bytes]]:
    """A data folder that a server left, a moment in it, and the state that it told of then."""
    folder = tmp_path_factory.mktemp("served")
    bins = bins_of(small_file())
    options = ("--simulate", "--speed", "20", "--auth", "none", "--scene")
    with serving(folder / "data", *options, str(small_scene(folder))) as server:
        server.order(bins[0], bins[1])
        at_ms = server.until_finished(server.order(bins[2], bins[-1]))["at_ms"]
        server.order(bins[1], bins[0])
        told = server.client.get("/api/ledger/state", params={"at": at_ms})
        assert told.status_code == 200
        assert server.stop() == 0
    yield folder / "data", at_ms, told.content


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_explains(words: tuple[str, ...]) -> None:
    shown = good(*words, "--help").output
    assert "Usage: fleetledger" in shown.replace("root", "fleetledger")
    assert len(re.findall(r"\w{3,}", shown)) > 25, "say more"
    options = re.findall(r"│\s+(?:\*\s+)?(--[a-z-]+)\s.*│", shown)
    assert "--help" in options
    for option in options:
        line = next(row for row in shown.splitlines() if option in row)
        assert len(line.strip("│ ").split()) > 2, f"{option} is not explained"


def test_nothing_at_all_gives_the_help() -> None:
    assert "fleetledger demo" in run().output


def test_a_generated_scene_is_good_and_the_same_each_time(tmp_path: Path) -> None:
    one, two, other = (tmp_path / name for name in ("one.json", "two.json", "other.json"))
    assert "3 robots" in good("scene", "generate", "-o", one, "--robots", 3).output
    good("scene", "generate", "-o", two, "--robots", 3)
    good("scene", "generate", "-o", other, "--robots", 3, "--seed", 2)
    assert one.read_bytes() == two.read_bytes() != other.read_bytes()
    good("scene", "check", one)


def test_maps_of_others_are_translated_with_their_names(tmp_path: Path) -> None:
    (tmp_path / "hall.smap").write_text(json.dumps(SMAP))
    (tmp_path / "grid.map").write_text(GRID)
    out = tmp_path / "scene.json"
    good("scene", "import", tmp_path / "hall.smap", "-o", out, "--robots", 1)
    scene = read_scene(out.read_bytes())
    assert [point.name for point in scene.areas[0].points] == ["LM1", "AP2"]
    assert [robot.simulated for robot in scene.robots] == [True]
    good("scene", "import", tmp_path / "grid.map", "-o", out, "--name", "maze")
    assert read_scene(out.read_bytes()).name == "maze"
    assert len(read_scene(out.read_bytes()).areas[0].points) == 5
    assert run("scene", "check", out).exit_code in (0, 1)


def test_verify_names_the_damaged_file(served: tuple[Path, int, bytes], tmp_path: Path) -> None:
    data, _, _ = served
    shown = good("verify", data).stdout
    assert shown.startswith("sound: ")
    copy = tmp_path / "ledger"
    copy.mkdir()
    segment = max((data / "ledger").glob(f"*{SUFFIX}"), key=lambda path: path.stat().st_size)
    for path in (data / "ledger").iterdir():
        (copy / path.name).write_bytes(path.read_bytes())
    raw = bytearray(segment.read_bytes())
    raw[len(raw) // 3] ^= 0xFF
    (copy / segment.name).write_bytes(raw)
    done = run("verify", tmp_path)
    assert done.exit_code == 1
    assert segment.name in done.stdout
    assert "DAMAGED" in done.stdout


def test_replay_tells_what_the_server_told(served: tuple[Path, int, bytes]) -> None:
    data, at_ms, told = served
    assert good("replay", data, "--at", at_ms, "--json").stdout_bytes.strip() == told
    assert "AMB-01" in good("replay", data, "--at", at_ms).stdout
    newest = json.loads(good("replay", data, "--at", "9999-01-01", "--json").stdout)
    assert newest["position"] >= json.loads(told)["position"]
    assert json.loads(good("replay", data, "--at", 1, "--json").stdout)["position"] == 0


def test_history_is_asked_in_sql(served: tuple[Path, int, bytes]) -> None:
    statement = "SELECT id, status FROM orders WHERE status = 'Done' ORDER BY id"
    rows = json.loads(good("sql", served[0], statement, "--format", "json").stdout)
    assert rows
    assert rows[0].keys() == {"id", "status"}
    table = list(csv.reader(good("sql", served[0], statement, "--format", "csv").stdout.split()))
    assert table == [["id", "status"], *([row["id"], row["status"]] for row in rows)]
    assert rows[0]["id"] in good("sql", served[0], statement).stdout


def test_a_recording_is_written(served: tuple[Path, int, bytes], tmp_path: Path) -> None:
    recording = tmp_path / "run.rrd"
    assert "run.rrd" in good("export", served[0], "--rrd", recording).output
    assert recording.read_bytes()[:3] == b"RRF"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("frobnicate",), "frobnicate"),
        (("verify", "{tmp}/nowhere"), "nowhere"),
        (("scene", "check", "{tmp}/bad.json"), "$.name"),
        (("scene", "check", "{tmp}"), "directory"),
        (("scene", "import", "{tmp}/bad.txt", "-o", "{tmp}/x"), ".smap"),
        (("scene", "import", "{tmp}/bad.smap", "-o", "{tmp}/x"), "JSON"),
        (("scene", "generate", "-o", "{tmp}/no/folder.json"), "folder.json"),
        (("scene", "generate", "-o", "{tmp}/x", "--robots", "0"), "robots"),
        (("replay", "{data}", "--at", "teatime"), "teatime"),
        (("replay", "{data}", "--at", "1", "--scene", "S"), "S"),
        (("export", "{data}", "--rrd", "{tmp}/x.rrd", "--from", "soon"), "soon"),
        (("sql", "{data}", "DROP TABLE orders"), "SELECT"),
        (("sql", "{data}", "SELECT nothing FROM orders"), "nothing"),
        (("sql", "{data}", "SELECT 1", "--format", "xml"), "xml"),
        (("serve", "--data", "{tmp}/d", "--auth", "perhaps"), "perhaps"),
        (("demo", "--robots", "0"), "robots"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    served: tuple[Path, int, bytes], tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    (tmp_path / "bad.json").write_text('{"name": 7}')
    (tmp_path / "bad.smap").write_text("{")
    (tmp_path / "bad.txt").write_text("")
    given = [argument.format(tmp=tmp_path, data=served[0]) for argument in arguments]
    assert words in bad(*given)
