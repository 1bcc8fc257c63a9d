"""A file that outlives a killed simulator: replaced whole, so that one of two states is there."""

from collections.abc import Callable
from pathlib import Path

import structlog

log = structlog.get_logger()


class Memory:
    """Where a simulated part keeps what it has told the world; without a path it keeps nothing."""

    def __init__(self, path: Path | None) -> None:
        """Take the file."""
        self._path = path
        self._in_vain = False

    def read(self) -> bytes | None:
        """Give what was kept; None where nothing is."""
        if self._path is None or not self._path.exists():
            return None
        return self._path.read_bytes()

    def save(self, state: Callable[[], bytes]) -> None:
        """Keep the state. On a disk that does not take it the simulation goes on; told once."""
        if self._path is None:
            return
        fresh = self._path.with_suffix(".new")
        try:
            fresh.write_bytes(state())
            fresh.replace(self._path)
            self._in_vain = False
        except OSError as trouble:
            if not self._in_vain:
                log.warning("simulation not kept", path=str(self._path), reason=str(trouble))
            self._in_vain = True
