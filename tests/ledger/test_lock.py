import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ledger.errors import LedgerLocked
from ledger.lock import Lock

HOLDER = """
import sys
from pathlib import Path
from ledger.lock import Lock
lock = Lock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def test_a_lock_of_a_killed_process_is_free(tmp_path: Path) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(LedgerLocked, match=f"in use by process {holder.pid}"):
            Lock(tmp_path)
        holder.send_signal(signal.SIGKILL)
        holder.wait()
        lock = Lock(tmp_path)
        assert (tmp_path / "lock").read_text() == f"{os.getpid()}\n"
        lock.close()
        lock.close()
    finally:
        holder.kill()
        holder.communicate()


PARENT = """
import subprocess, sys
from pathlib import Path
from ledger.lock import Lock
lock = Lock(Path(sys.argv[1]))
child = subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=sys.stdin)
print(child.pid, flush=True)
child.wait()
"""


def test_a_child_that_outlives_its_parent_keeps_no_lock(tmp_path: Path) -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert parent.stdout is not None
    child = os.pidfd_open(int(parent.stdout.readline()))
    try:
        with pytest.raises(LedgerLocked):
            Lock(tmp_path)
        parent.kill()
        parent.wait()
        assert not select.select([child], [], [], 0)[0], "the child should live"
        Lock(tmp_path).close()
    finally:
        parent.communicate()  # closes its standard input, which ends the child
        select.select([child], [], [])
        os.close(child)
