"""`python -m tests.laws.crash --seed 7`: live through one seed, or through many from it on."""

import argparse
import logging
import sys
import time

import structlog

from tests.laws.crash.simulation import STEPS, simulate


def main() -> int:
    """Give 1 where a seed fails, with everything that its roles had logged."""
    parser = argparse.ArgumentParser(prog="python -m tests.laws.crash", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="the first one")
    parser.add_argument("--steps", type=int, default=STEPS, help="of one simulation")
    parser.add_argument("--count", type=int, default=1, help="so many seeds")
    parser.add_argument("--log", action="store_true", help="show what the roles log")
    chosen = parser.parse_args()
    level = logging.INFO if chosen.log else logging.CRITICAL
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(level))
    began = time.perf_counter()
    for seed in range(chosen.seed, chosen.seed + chosen.count):
        done = simulate(seed, chosen.steps)
        seen = ", ".join(f"{count} {what}" for what, count in sorted(done.seen.items()))
        print(f"seed {seed}: {done.events} events, {done.calls} calls, {seen}; {done.digest[:16]}")
    took_s = time.perf_counter() - began
    rate = (
        f"{chosen.count / took_s:.2f} seeds/s, {chosen.count / time.process_time():.2f} of a core"
    )
    print(rate, file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
