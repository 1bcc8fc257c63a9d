"""Structured logs on standard error: for people on a terminal, as JSON lines elsewhere."""

import logging
import sys
from typing import TextIO, cast

import structlog


class Lossy:
    """A stream that drops what cannot be written.

    Standard error may be a file on a full disk, and nothing may fail because it cannot be told.
    """

    def __init__(self, stream: TextIO) -> None:
        """Take the stream to write to."""
        self._stream = stream

    def write(self, text: str) -> int:
        """Write it, or not."""
        try:
            return self._stream.write(text)
        except OSError:
            return len(text)

    def flush(self) -> None:
        """Bring it on its way, if it can be."""
        try:
            self._stream.flush()
        except OSError:
            return


def configure(*, process: str, as_json: bool) -> None:
    """Send all logs, the libraries' too, to standard error in one form."""
    shared: list[structlog.types.Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
    ]
    renderer: structlog.types.Processor = (
        structlog.processors.JSONRenderer()
        if as_json
        else structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())
    )
    structlog.configure(
        processors=[*shared, renderer],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.PrintLoggerFactory(cast("TextIO", Lossy(sys.stderr))),
        cache_logger_on_first_use=True,
    )
    structlog.contextvars.bind_contextvars(process=process)
    logging.basicConfig(
        level=logging.WARNING, stream=Lossy(sys.stderr), format="%(levelname)s %(message)s"
    )
