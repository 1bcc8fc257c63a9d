"""Opens a past moment in the Rerun viewer, on this machine only.

Rerun's servers listen on all interfaces and without keys unless told otherwise, its Python
functions without a choice (measured, 0.41). So its own program is started, bound to loopback, and
the real child is stopped at the end, not a launcher.
"""

import os
import subprocess
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread
from typing import IO

from rerun.catalog import DatasetEntry
from rerun_bindings import CatalogClientInternal  # the public client wants a query engine besides
from rich.console import Console

from ledger.errors import Refused
from replay.export import Progress, blueprint, export_rrd
from replay.layers import TIMELINE

LOOPBACK = "127.0.0.1"
AROUND_MS = 10 * 60_000  # of the past is shown on either side of the moment
START_S_MAX = 30.0  # until a child says where it listens
STOP_S_MAX = 5.0
DATASET = "scene"


@contextmanager
def opened(
    data: Path, *, at_ms: int, scene: str | None = None, progress: Progress | None = None
) -> Iterator[str]:
    """Serve the minutes around a moment; gives the address of a page that opens there."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="fleetledger-rerun-")))
        recordings, layout = folder / "recordings", folder / "layout.rbl"
        shown = export_rrd(
            data,
            recordings / "scene.rrd",
            scene=scene,
            from_ms=max(0, at_ms - AROUND_MS),
            to_ms=at_ms + AROUND_MS,
            progress=progress,
        )
        blueprint(shown).save(DATASET, layout)
        server = _started(
            stack,
            ["server", "--host", LOOPBACK, "--port", "0", "--dataset", f"{DATASET}={recordings}"],
            f"rerun+http://{LOOPBACK}:",
        )
        moment = _moment(server, at_ms, layout)
        viewer = ["--serve-web", "--bind", LOOPBACK, "--web-viewer-port", "0", moment]
        yield _started(stack, viewer, f"http://{LOOPBACK}:", "connect at ")


def show(
    data: Path, *, at_ms: int, scene: str | None = None, progress: Progress | None = None
) -> None:
    """Open a moment in the browser, and keep serving it until Ctrl-C."""
    people = Console(stderr=True)
    with opened(data, at_ms=at_ms, scene=scene, progress=progress) as address:
        people.print(f"Rerun shows it at {address}", soft_wrap=True)
        people.print("On this machine only. Ctrl-C ends it.")
        webbrowser.open(address)
        try:
            Event().wait()
        except KeyboardInterrupt:
            people.print("Stopped.")


def _moment(server: str, at_ms: int, layout: Path) -> str:
    """Give the address of the recording at the moment; the catalog obeys `#when=`, /proxy not."""
    known = CatalogClientInternal(server).datasets(False)
    dataset = DatasetEntry(next(d for d in known if d.entry_details().name == DATASET))
    dataset.register_blueprint(layout.as_uri())  # the one in the recording is not used here
    segment = dataset.segment_ids()[0]
    at = datetime.fromtimestamp(at_ms / 1000, UTC)
    return dataset.segment_url(segment, TIMELINE, at)


def program() -> Path:
    """Give Rerun's own program, not the script that starts it."""
    name = "rerun.exe" if os.name == "nt" else "rerun"
    package = find_spec("rerun_cli")
    if package is None or package.origin is None:
        raise Refused("errRerunMissing", "The package rerun-sdk is not installed.")
    return Path(package.origin).parent / name


def _started(stack: ExitStack, arguments: list[str], prefix: str, before: str = "") -> str:
    """Start a child, wait until it says its address, and see to its end."""
    child = subprocess.Popen(
        [program(), *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"RUST_LOG": "info", "NO_COLOR": "1"},
        start_new_session=True,  # Ctrl-C comes to us, and we stop it
    )
    stack.callback(_stop, child)
    assert child.stderr is not None
    listener = _Listener(child.stderr, before + prefix, len(before))
    stack.callback(listener.join, STOP_S_MAX)
    stack.callback(_stop, child)
    return listener.address(child)


def _stop(child: "subprocess.Popen[str]") -> None:
    child.terminate()
    try:
        child.wait(STOP_S_MAX)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


class _Listener(Thread):
    """Reads what a child says, to the end, so that it never waits for a reader."""

    def __init__(self, stream: IO[str], mark: str, skip: int) -> None:
        super().__init__(name="rerun-log", daemon=True)
        self._stream, self._mark, self._skip = stream, mark, skip
        self._heard = Event()
        self._address: str | None = None
        self._last = ""
        self.start()

    def run(self) -> None:
        with self._stream:
            for line in self._stream:
                self._last = line.strip()
                at = line.find(self._mark)
                if at >= 0 and self._address is None:
                    self._address = line[at + self._skip :].split()[0]
                    self._heard.set()
        self._heard.set()

    def address(self, child: "subprocess.Popen[str]") -> str:
        """Wait for it; raises Refused with the child's last words."""
        self._heard.wait(START_S_MAX)
        if self._address is None:
            words = f"Rerun did not start (exit {child.poll()}): {self._last[:300]}"
            raise Refused("errRerunFailed", words)
        return self._address
