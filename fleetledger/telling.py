"""Expected trouble of the command line, in words for people."""

import sys

import structlog
import typer
from pydantic import ValidationError
from rich.console import Console
from rich.markup import escape

from ledger.errors import LedgerError, Refused, next_step

errors = Console(stderr=True, soft_wrap=True)  # a path that is wrapped cannot be copied


class told:
    """Say expected trouble in one line with a hint, and exit 2; bugs keep their traceback."""

    def __enter__(self) -> None:
        """Keep logs off standard output, which is for answers; a server sets up its own."""
        if not structlog.is_configured():
            structlog.configure(logger_factory=lambda *_: structlog.PrintLogger(sys.stderr))

    def __exit__(self, kind: object, trouble: BaseException | None, trace: object) -> None:
        if isinstance(trouble, LedgerError):
            errors.print(
                f"[red]{type(trouble).__name__}[/]: {escape(str(trouble))}\n{trouble.hint}"
            )
        elif isinstance(trouble, Refused):
            errors.print(f"[red]{trouble.code}[/]: {escape(trouble.message)}")
        elif isinstance(trouble, OSError) and trouble.filename is not None:
            words = f"[red]{trouble.strerror}[/]: {escape(str(trouble.filename))}"
            errors.print(f"{words}\n{next_step(trouble)}".strip())
        elif isinstance(trouble, ValidationError):
            for fault in trouble.errors():
                name = ".".join(str(part) for part in fault["loc"]) or "options"
                words = fault["msg"].removeprefix("Value error, ")
                errors.print(f"[red]{name}[/]: {escape(words)}")
        else:
            return
        raise typer.Exit(2)
