"""Long work of our own threads gives way to those who answer clients.

Python's lock goes from thread to thread at most every half millisecond, so work in slices of about
a millisecond, with a pause between them while somebody waits, costs a client little.
"""

from collections.abc import Callable
from typing import TypeAlias

GiveWay: TypeAlias = Callable[[], None]  # called between slices; pauses if it has to


def at_once() -> None:
    """Give way to nobody."""
