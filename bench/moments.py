"""The state at past moments of a ledger of a million events: cold, and with snapshots."""

import random
import shutil
import tempfile
import time
from pathlib import Path

from bench.ledgers import START_MS, write
from ledger.moment import At
from replay.moment import Moments

EVENTS = 1_000_000


def main() -> list[dict[str, float | str]]:
    """Ask for random moments."""
    folder = Path(tempfile.mkdtemp(prefix="fleetledger-bench-"))
    rows: list[dict[str, float | str]] = []
    try:
        write(folder, EVENTS)
        chance = random.Random(1)
        moments = [START_MS + chance.randrange(EVENTS) * 10 for _ in range(8)]
        for what in ("with snapshots", "cold, no snapshots"):
            if what.startswith("cold"):
                shutil.rmtree(folder / "snapshots")
            took = []
            for at_ms in moments:
                began = time.perf_counter()
                Moments(folder).fleet(At(at_ms=at_ms))
                took.append((time.perf_counter() - began) * 1e3)
            row: dict[str, float | str] = {
                "what": f"state at a moment of {EVENTS:,} events, {what}",
                "median_ms": sorted(took)[len(took) // 2],
                "worst_ms": max(took),
            }
            print(", ".join(f"{k} {v:,.1f}" if isinstance(v, float) else v for k, v in row.items()))
            rows.append(row)
    finally:
        shutil.rmtree(folder)
    return rows


if __name__ == "__main__":
    main()
