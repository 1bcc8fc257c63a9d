"""Runs the cookbook's commands in one shell, and writes what they print into the page.

`python -m tests.fleetledger.cookbook` writes docs/cookbook.md anew.
"""

import os
import re
import select
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "cookbook.md"
MAP = ROOT / "../shared/data/smap/ws_ps_bins.smap"
PORT = "5800"  # of the page
COMMAND_S_MAX = 120.0
END = "__end_of_answer__"


def blocks(page: str) -> Iterator[tuple[int, int, str]]:
    """Find the blocks that are run: where each begins and ends, and what it holds."""
    for found in re.finditer(r"```console\n(.*?)```", page, re.DOTALL):
        yield found.start(1), found.end(1), found[1]


def commands(block: str) -> list[tuple[str, str]]:
    """Take a block apart: each command, and what it printed."""
    found: list[tuple[list[str], list[str]]] = []
    here = False  # within a here-document, whose lines are the command's own
    for line in block.splitlines():
        if here:
            found[-1][0].append(line)
            here = line != "END"
        elif line.startswith("$ "):
            found.append(([line[2:]], []))
            here = line.endswith("<<END")
        else:
            found[-1][1].append(line)
    return [("\n".join(asked), "\n".join(told)) for asked, told in found]


class Shell:
    """One bash in a folder with the map, on a free port instead of the page's."""

    def __init__(self, folder: Path) -> None:
        shutil.copy(MAP, folder / "hall.smap")
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = str(probe.getsockname()[1])
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        self._bash = subprocess.Popen(
            ["bash", "--norc"],
            cwd=folder,
            env={"PATH": path, "HOME": str(folder), "COLUMNS": "100", "LC_ALL": "C.UTF-8"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            bufsize=0,
        )

    def run(self, command: str) -> str:
        """Run one command; gives what it printed, in the page's words."""
        assert self._bash.stdin is not None
        asked = command.replace(PORT, self._port)
        self._bash.stdin.write(f"{asked}\necho; echo {END}\n".encode())
        told = self._read_to_end(command)
        return told.replace(self._port, PORT).replace("\r", "").strip("\n")

    def _read_to_end(self, command: str) -> str:
        assert self._bash.stdout is not None
        deadline = time.monotonic() + COMMAND_S_MAX
        raw = b""
        while END.encode() not in raw:
            left_s = deadline - time.monotonic()
            ready = select.select([self._bash.stdout], [], [], max(0.0, left_s))[0]
            assert ready, f"no end of: {command}\n{raw.decode()}"
            raw += os.read(self._bash.stdout.fileno(), 65_536)
        return raw.decode().partition(END)[0]

    def close(self) -> None:
        """Leave nothing behind."""
        self.run(f"kill -9 $(pgrep -f 'fleetledger serve --data hall .*{PORT}') 2>/dev/null")
        self._bash.kill()
        self._bash.wait()
        for pipe in (self._bash.stdin, self._bash.stdout):
            if pipe is not None:
                pipe.close()


def written(page: str, shell: Shell) -> str:
    """Give the page with the answers of this run."""
    parts, at = [], 0
    for start, end, block in blocks(page):
        answers = []
        for command, _ in commands(block):
            told = shell.run(command)
            answers.append(f"$ {command}\n" + (f"{told}\n" if told else ""))
        parts += [page[at:start], "".join(answers)]
        at = end
    return "".join([*parts, page[at:]])


def main() -> None:
    """Write the page anew."""
    with tempfile.TemporaryDirectory() as folder:
        shell = Shell(Path(folder))
        try:
            PAGE.write_text(written(PAGE.read_text(), shell))
        finally:
            shell.close()


if __name__ == "__main__":
    main()
