"""Children end when the server has gone, however it went."""

import sys
import threading


def stop_when_orphaned() -> threading.Event:
    """Give an event that is set when standard input closes: then the server has gone."""
    stop = threading.Event()

    def watch() -> None:
        while sys.stdin.buffer.read(4096):
            pass
        stop.set()

    threading.Thread(target=watch, name="orphaned", daemon=True).start()
    return stop
