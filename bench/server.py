"""A real server for benchmarks: the program as a user starts it, in a folder of its own."""

import json
import shutil
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from ledger.scene import SceneFile


class Running(NamedTuple):
    """A server that answers."""

    port: int
    data: Path
    scene: str
    process: "subprocess.Popen[str]"

    def get(self, path: str) -> Any:
        """Call it once."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}") as answer:
            return json.loads(answer.read())


@contextmanager
def running(scene: SceneFile, *options: str, data: Path | None = None) -> Iterator[Running]:
    """Start `fleetledger serve` on a scene, wait until it is ready, and stop it in the end."""
    folder = data or Path(tempfile.mkdtemp(prefix="fleetledger-bench-"))
    file = folder / "scene.json"
    file.write_bytes(msgspec.json.encode(scene))
    command = [sys.executable, "-m", "fleetledger", "serve", "--data", str(folder / "data")]
    command += ["--port", "0", "--auth", "none", "--scene", str(file), *options]
    log = (folder / "log").open("w")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line.startswith("ready "):
            raise RuntimeError(f"the server did not start, see {folder / 'log'}")
        port = int(line.strip().rsplit(":", 1)[1])
        server = Running(port, folder / "data", "", process)
        yield server._replace(scene=server.get("/api/fleet/scenes/list")[0]["id"])
    finally:
        process.terminate()
        process.wait(10)
        log.close()
        if data is None:
            shutil.rmtree(folder)
