"""A moment as text says who stood where, and why orders wait."""

from pathlib import Path

from rich.console import Console

from ledger.moment import At
from ledger.state import Fleet
from ledger.telemetry import reports_at
from replay.report import describe
from tests.replay.site import SCENE, START_MS, Site


def printed(what: object) -> str:
    console = Console(width=200, no_color=True, force_terminal=False)
    with console.capture() as caught:
        console.print(what)
    return caught.get()


def test_robots_and_orders_are_shown_as_they_were(tmp_path: Path) -> None:
    site = Site(tmp_path)
    site.run(30)
    at_ms = START_MS + 12_000
    fleet = site.source.moments.fleet(At(at_ms=at_ms))
    text = printed(describe(fleet, {SCENE: reports_at(tmp_path / "telemetry", SCENE, at_ms)}))
    site.close()
    rows = {line.split()[0]: line for line in text.splitlines() if line.strip()}
    assert "moving" in rows["R1"] and "72%" in rows["R1"]
    assert "charging" in rows["R2"]
    assert "offline" in rows["R3"] and "unknown" in rows["R3"]
    assert "B1 → B6" in rows["TO20261122-000002"] and "under way" in rows["TO20261122-000002"]
    assert "R3: offline" in text


def test_before_the_first_event_it_says_so() -> None:
    assert "before the first event" in printed(describe(Fleet(), {}))
