"""`make bench`: run every benchmark, print its table, and keep its rows in bench/results/."""

import sys
from importlib import import_module
from pathlib import Path

import msgspec

NAMES = ("append", "create", "read", "moments", "assign", "planner", "sim", "shift")
RESULTS = Path(__file__).parent / "results"


def main() -> None:
    """Run those named on the command line, or all."""
    RESULTS.mkdir(exist_ok=True)
    for name in [a for a in sys.argv[1:] if not a.startswith("-")] or NAMES:
        print(f"\n== {name}", flush=True)
        rows = import_module(f"bench.{name}").main()
        (RESULTS / f"{name}.json").write_bytes(msgspec.json.format(msgspec.json.encode(rows)))


main()
