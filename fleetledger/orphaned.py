"""Children end when the server has gone, however it went."""

import os
import sys
import threading


def stop_when_orphaned() -> threading.Event:
    """Give an event that is set when standard input closes: then the server has gone."""
    stop = threading.Event()
    descriptor = sys.stdin.fileno()

    def watch() -> None:
        # not by sys.stdin: its lock, held here, would abort a child that ends by itself
        while os.read(descriptor, 4096):
            pass
        stop.set()

    threading.Thread(target=watch, name="orphaned", daemon=True).start()
    return stop
