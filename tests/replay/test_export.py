"""A recording of the past is whole, can be read back, and is shown on this machine only."""

import subprocess
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledger.errors import Refused
from ledger.link import Plan, Report
from ledger.state import Fleet
from replay.curves import PARTS, lines_of, polyline
from replay.export import export_rrd
from replay.pictures import Picture, film
from replay.viewer import opened, program
from tests.replay.site import R1, SCENE, START_MS, Site, plans, reports
from tests.strategies import grid


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("site")
    site = Site(folder)
    site.run(60)
    site.close()
    yield folder


def rerun(*arguments: str | Path) -> str:
    done = subprocess.run([program(), *arguments], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_recording_is_written_and_read_back_by_rerun_itself(data: Path, tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    file = tmp_path / "out" / "site.rrd"
    export_rrd(data, file, progress=lambda done, of: steps.append((done, of)))
    assert steps[-1][0] == steps[-1][1] > 0
    rerun("rrd", "verify", file)
    said = rerun("rrd", "print", file)
    for entity in ("/robots", "/footprints", "/ways", "/loads", "/orders", "/map/paths"):
        assert f" - {entity} - " in said
    assert list(file.parent.iterdir()) == [file]  # nothing half-written is left


def test_a_stretch_can_be_chosen(data: Path, tmp_path: Path) -> None:
    whole, part = tmp_path / "whole.rrd", tmp_path / "part.rrd"
    export_rrd(data, whole, scene=SCENE)
    export_rrd(data, part, scene=SCENE, from_ms=START_MS + 20_000, to_ms=START_MS + 25_000)
    assert part.stat().st_size < whole.stat().st_size


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ({"scene": "nowhere"}, "there were: 5f0c1e9a2b3c4d5e6f708192"),
        ({"from_ms": START_MS + 9_000, "to_ms": START_MS}, "'to' is wrong"),
        ({"to_ms": START_MS + 10**9}, "'from' is wrong"),
    ],
)
def test_what_cannot_be_recorded_is_refused_in_words(
    data: Path, tmp_path: Path, query: dict, words: str
) -> None:
    with pytest.raises(Refused, match=words):
        export_rrd(data, tmp_path / "x.rrd", **query)


def test_an_empty_folder_has_nothing_to_record(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="nothing in"):
        export_rrd(tmp_path, tmp_path / "x.rrd")


def test_the_viewer_listens_on_this_machine_only_and_ends_with_us(data: Path) -> None:
    with opened(data, at_ms=START_MS + 30_000) as address:
        assert address.startswith("http://127.0.0.1:")
        assert "when%3Dsite%5Ftime%402026%2D11%2D22T10%3A30%3A30" in address
        with urllib.request.urlopen(address, timeout=20) as page:
            assert page.status == 200
        port = int(address.split(":")[2].split("?")[0].rstrip("/"))
        assert [line for line in listening(port) if not line.startswith("0100007F:")] == []
    assert listening(port) == []


def listening(port: int) -> list[str]:
    """Local addresses on which this machine listens at a port, as the kernel lists them."""
    found = []
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        path = Path(table)
        if not path.exists():
            pytest.skip("the kernel does not list its sockets here")
        for line in path.read_text().splitlines()[1:]:
            local, state = line.split()[1], line.split()[3]
            if state == "0A" and int(local.rsplit(":", 1)[1], 16) == port:
                found.append(local)
    return found


@given(step_ms=st.integers(50, 3_000), seconds=st.integers(1, 8))
def test_every_picture_of_a_film_shows_the_newest_report(step_ms: int, seconds: int) -> None:
    times = range(START_MS + 100, START_MS + seconds * 1_000 + 1, 100)
    said: list[Report] = [r for t in times for r in reports(t)]
    meant: list[Plan] = [p for t in times for p in plans(t)]
    end_ms = START_MS + seconds * 1_000
    shown = film(
        Picture(Fleet(), {}, {}), iter(()), iter(said), iter(meant), START_MS, end_ms, step_ms
    )
    at_ms = START_MS
    for picture in shown:
        at_ms = picture.at_ms
        newest = [r for r in said if r.robot == R1 and r.at_ms <= at_ms]
        assert picture.reports.get(R1) == (newest[-1] if newest else None)
    assert at_ms == end_ms


def test_curves_keep_their_ends_and_straight_paths_stay_two_points() -> None:
    curve = polyline(((0.0, 0.0), (1.0, 2.0), (2.0, 0.0)))
    assert (curve[0], curve[-1], len(curve)) == ((0.0, 0.0), (2.0, 0.0), PARTS + 1)
    assert curve[PARTS // 2] == (1.0, 1.0)
    area = grid().areas[0]
    lines = lines_of(area)
    assert len(lines) == len(area.paths)
    assert {len(line) for line in lines.values()} == {2}
