"""How far the history has been rebuilt, for people who watch the server start."""

import sys

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

EVENTS_MIN = 50_000  # fewer are there before one has read the line


class RebuildBar:
    """A bar on standard error where that is a terminal; the log tells the others."""

    def __init__(self) -> None:
        """Show nothing yet."""
        self._shown: Progress | None = None

    def advance(self, position: int, newest: int) -> None:
        """Take how far it is: a bar appears where much is to be done, and goes at its end."""
        if self._shown is None and newest - position >= EVENTS_MIN and sys.stderr.isatty():
            words = TextColumn("rebuilding the history")
            columns = (words, BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
            self._shown = Progress(*columns, console=Console(stderr=True), transient=True)
            self._shown.add_task("history", total=newest, completed=position)
            self._shown.start()
        elif self._shown is not None:
            (task,) = self._shown.task_ids
            self._shown.update(task, completed=position, total=newest)
            if newest - position < EVENTS_MIN // 10:
                self._shown.stop()
                self._shown = None
