"""`make bench-traffic`: every instance that traffic is held against, in one table.

Run as `python -m bench.traffic [--quick] [floors methods maps grids fleets]`. All is simulated: the
same rows on every machine, but for processor times.
"""

import argparse
from importlib import import_module
from pathlib import Path

import msgspec

from bench.tables import show

NAMES = ("floors", "methods", "maps", "grids", "fleets")
RESULTS = Path(__file__).parent / "results"


def main() -> None:
    """Run those named, or all; print as they come, and keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=NAMES, help=", ".join(NAMES))
    parser.add_argument("--quick", action="store_true", help="minutes in place of hours")
    chosen = parser.parse_args()
    unknown = sorted(set(chosen.names) - set(NAMES))
    if unknown:
        parser.error(f"there is no {unknown[0]}; there are {', '.join(NAMES)}")
    RESULTS.mkdir(exist_ok=True)
    for name in chosen.names:
        rows = import_module(f"bench.{name}").rows(quick=chosen.quick)
        show(f"traffic: {name}", rows)
        kept = RESULTS / f"traffic-{name}.json"
        kept.write_bytes(msgspec.json.format(msgspec.json.encode(rows)))


if __name__ == "__main__":
    main()
