"""`make bench`: run every benchmark, print its table, and keep its rows in bench/results/."""

import sys
from importlib import import_module
from pathlib import Path

import msgspec

NAMES = (
    "append",
    "seal",
    "create",
    "calls",
    "read",
    "scale",
    "assign",
    "planner",
    "sim",
    "shift",
    "stream",
    "telemetry",
    "peers",
    "startup",
)
RESULTS = Path(__file__).parent / "results"


def main() -> None:
    """Run those named on the command line, or all."""
    RESULTS.mkdir(exist_ok=True)
    for name in sys.argv[1:] or NAMES:
        print(f"\n== {name}", flush=True)
        sys.argv = [name]  # some take options of their own when run alone
        rows = import_module(f"bench.{name}").main()
        if rows is not None:  # the others have written their own file
            (RESULTS / f"{name}.json").write_bytes(msgspec.json.format(msgspec.json.encode(rows)))


main()
