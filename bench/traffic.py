"""`make bench-traffic`: every instance that traffic is held against, in one table.

Run as `python -m bench.traffic [--quick] [floors grids maps fleets]`. All is simulated: the same
rows on every machine, but for processor times.
"""

import argparse
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table

NAMES = ("floors", "maps", "grids", "fleets")
RESULTS = Path(__file__).parent / "results"


def show(console: Console, title: str, rows: Iterable[dict[str, float | str]]) -> None:
    """Print rows that need not have the same columns."""
    rows = list(rows)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    table = Table(title=title)
    for column in columns:
        table.add_column(column, justify="right")
    for row in rows:
        values = (row.get(column, "") for column in columns)
        table.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in values))
    console.print(table)


def main() -> None:
    """Run those named, or all; print as they come, and keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*NAMES, []], default=NAMES)
    parser.add_argument("--quick", action="store_true", help="minutes in place of hours")
    chosen = parser.parse_args()
    RESULTS.mkdir(exist_ok=True)
    console = Console(width=180)
    for name in chosen.names:
        rows = import_module(f"bench.{name}").rows(quick=chosen.quick)
        show(console, f"traffic: {name}", rows)
        kept = RESULTS / f"traffic-{name}.json"
        kept.write_bytes(msgspec.json.format(msgspec.json.encode(rows)))


if __name__ == "__main__":
    main()
