"""`python -m tests.soak --minutes 20 --seed 1`: random stories of the whole, for as long as wanted.

A stage is a function `stage(seed)` of a test module: other seeds, longer stories, at most about a
minute. All are found by that name, and run in turn with growing seeds, each call in a process of
its own, one for each processor. Crashes on a bad disk take every second turn. At the first failure
the rest is stopped, and the command that repeats it is printed.
"""

import argparse
import importlib
import logging
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path
from typing import IO

import structlog

ROOT = Path(__file__).parent.parent
CRASH = "tests.laws.test_crash_laws"
SEEDS_APART = 100_000  # calls of one stage in a soak, before seeds meet those of the next --seed
CALL_S_MAX = 600.0  # then a stage hangs
LINE_S = 30.0  # between two lines of progress
POLL_S = 0.2
TAIL_LINES = 80  # of a failed call's output


def stages() -> list[str]:
    """Modules that have a stage."""
    found = []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        if re.search(r"^def stage\(", path.read_text(), re.MULTILINE):
            found.append(".".join(path.relative_to(ROOT).with_suffix("").parts))
    return found


def turns(seed: int) -> Iterator[tuple[str, int]]:
    """Name stage after stage, and the seed of each call."""
    calls: Counter[str] = Counter()
    for other in cycle([name for name in stages() if name != CRASH]):
        for name in (CRASH, other):
            calls[name] += 1
            yield name, seed * SEEDS_APART + calls[name]


class Call:
    """A stage at work in a process of its own."""

    def __init__(self, stage: str, seed: int) -> None:
        self.stage = stage
        self.arguments = ["-m", "tests.soak", "--stage", stage, "--seed", str(seed)]
        self.began = time.monotonic()
        self._output: IO[str] = tempfile.TemporaryFile("w+")  # noqa: SIM115 - lives with the call
        self._process = subprocess.Popen(
            [sys.executable, *self.arguments],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # so that its servers end with it
        )

    def ended(self) -> bool | None:
        """Tell whether it went well; None while it runs."""
        if self._process.poll() is None:
            if time.monotonic() - self.began < CALL_S_MAX:
                return None
            self.stop()
            return False
        return self._process.returncode == 0

    def stop(self) -> None:
        """End it and all that it has started."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()

    def tail(self) -> str:
        """Give the end of what it said."""
        self._output.seek(0)
        return "".join(self._output.readlines()[-TAIL_LINES:])


class Soak:
    """Keeps as many calls at work as there are processors, until time is up."""

    def __init__(self, minutes: float, seed: int) -> None:
        self._began = time.monotonic()
        self._until = self._began + 60 * minutes
        self._turns = turns(seed)
        self._calls: list[Call] = []
        self._done: Counter[str] = Counter()
        self._busy_s: Counter[str] = Counter()
        self._failed: Call | None = None

    def run(self) -> int:
        """Give 0 if nothing failed."""
        told = 0.0
        try:
            while self._failed is None and (self._calls or self._left_s() > 0):
                while self._left_s() > 0 and len(self._calls) < (os.cpu_count() or 1):
                    self._calls.append(Call(*next(self._turns)))
                time.sleep(POLL_S)  # of several processes none can be waited for alone
                self._look()
                if time.monotonic() - told > LINE_S:
                    told = time.monotonic()
                    print(self._line(), flush=True)
        except KeyboardInterrupt:
            print("stopped before its time")
        finally:
            for call in self._calls:
                call.stop()
        return self._report()

    def _left_s(self) -> float:
        return self._until - time.monotonic()

    def _look(self) -> None:
        for call in list(self._calls):
            good = call.ended()
            if good is None:
                continue
            self._calls.remove(call)
            self._done[call.stage] += 1
            self._busy_s[call.stage] += time.monotonic() - call.began
            if not good and self._failed is None:
                self._failed = call

    def _line(self) -> str:
        minutes, seconds = divmod(int(time.monotonic() - self._began), 60)
        calls = ", ".join(f"{_short(name)} {n}" for name, n in sorted(self._done.items()))
        return f"{minutes:3}:{seconds:02}  {calls or 'begins'}"

    def _report(self) -> int:
        print(self._line())
        for name, busy_s in self._busy_s.most_common():
            calls = self._done[name]
            print(f"  {_short(name):24} {calls:5} calls, {busy_s / calls:6.1f} s each")
        if self._failed is None:
            print("nothing failed")
            return 0
        print(self._failed.tail())
        print(f"{self._failed.stage} failed. To repeat it:")
        print("  .venv/bin/python " + " ".join(self._failed.arguments))
        return 1


def _short(stage: str) -> str:
    return stage.rpartition(".")[2].removeprefix("test_")


def main() -> int:
    """Soak, or do one call of one stage."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=1, help="of the soak, or of the one call")
    parser.add_argument("--stage", choices=stages(), help="do one call of this stage only")
    chosen = parser.parse_args()
    if chosen.stage is None:
        return Soak(chosen.minutes, chosen.seed).run()
    quiet = structlog.make_filtering_bound_logger(logging.CRITICAL)
    structlog.configure(wrapper_class=quiet)
    importlib.import_module(chosen.stage).stage(chosen.seed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
