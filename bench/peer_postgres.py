"""PostgreSQL as `bench.peers` measures it: a cluster of its own, made for the occasion."""

import os
import pwd
import subprocess
import tempfile
import time
from pathlib import Path
from typing import cast

import psycopg

from bench.peer_stores import FILL, PAGE, Ran, decode, in_threads, row

START_S_MAX = 60.0
CONNECTIONS_MAX = 600
POSTGRES = Path("/usr/lib/postgresql/15/bin")


class Postgres:
    """A cluster of its own, over a Unix socket: a connection each, a transaction each."""

    def __init__(self, folder: Path) -> None:
        self.name = "PostgreSQL, a connection each"
        self._socket = tempfile.mkdtemp(prefix="fleetledger-pg-")
        self._numbers = iter(range(1, 1 << 62))
        user = _unprivileged()
        if user is not None:
            for path in (folder, Path(self._socket)):
                os.chown(path, user, -1)
        cluster = folder / "cluster"
        command = [str(POSTGRES / "initdb"), "-D", str(cluster), "-U", "bench", "-A", "trust"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, user=user, cwd=folder)
        options = ("fsync=on", "synchronous_commit=on", "listen_addresses=", "shared_buffers=256MB")
        flags = [f"-c{option}" for option in (*options, f"max_connections={CONNECTIONS_MAX}")]
        log = (folder / "log").open("w")
        self._server = subprocess.Popen(
            [POSTGRES / "postgres", "-D", cluster, "-k", self._socket, *flags],
            stderr=log,
            user=user,
            cwd=folder,
        )
        log.close()
        self._wait()
        with self.connect() as connection:
            connection.execute(
                "CREATE TABLE events (position bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,"
                " stream text NOT NULL, version bigint NOT NULL, payload bytea NOT NULL,"
                " UNIQUE (stream, version))"
            )

    def _wait(self) -> None:
        end = time.monotonic() + START_S_MAX
        while True:
            try:
                self.connect().close()
                return
            except psycopg.OperationalError:
                if time.monotonic() > end or self._server.poll() is not None:
                    raise
                time.sleep(0.1)  # it tells nobody when it takes connections

    def connect(self) -> "psycopg.Connection[tuple[object, ...]]":
        """Open one more."""
        return psycopg.connect(
            host=self._socket, user="bench", dbname="postgres", autocommit=True, prepare_threshold=1
        )

    def _insert(self, connection: "psycopg.Connection[tuple[object, ...]]") -> None:
        connection.execute(
            "INSERT INTO events (stream, version, payload) VALUES (%b, %b, %b)",
            row(next(self._numbers)),
        )

    def run(self, clients: int, seconds: float) -> Ran:
        """Commit one event after the other on each connection."""
        connections = [self.connect() for _ in range(clients)]

        def once(client: int) -> int:
            self._insert(connections[client])
            return 1

        try:
            return in_threads(clients, seconds, once)
        finally:
            for connection in connections:
                connection.close()

    def fill(self, count: int) -> None:
        """Append in transactions of many."""
        with self.connect() as connection:
            for first in range(0, count, FILL):
                with connection.transaction():
                    for _ in range(min(FILL, count - first)):
                        self._insert(connection)

    def read(self) -> int:
        """Read in order of position."""
        with (
            self.connect() as connection,
            connection.transaction(),
            connection.cursor("all", binary=True) as cursor,
        ):
            cursor.itersize = PAGE
            cursor.execute("SELECT payload FROM events ORDER BY position")
            return sum(decode(cast("bytes", payload)) is not None for (payload,) in cursor)

    def size_bytes(self) -> int:
        """Tell the size of the table and its indexes; the write-ahead log is recycled."""
        with self.connect() as connection:
            found = connection.execute("SELECT pg_total_relation_size('events')").fetchone()
            assert found is not None
            return int(str(found[0]))

    def sealed_bytes_per_event(self) -> float | None:
        """Nothing of the kind."""
        return None

    def close(self) -> None:
        """Stop the server at once."""
        self._server.send_signal(2)
        self._server.wait(60)
        for left in Path(self._socket).iterdir():
            left.unlink()
        Path(self._socket).rmdir()


def _unprivileged() -> int | None:
    """Choose who runs PostgreSQL, which refuses to be root; None = who we are."""
    if os.geteuid() != 0:
        return None
    try:
        return pwd.getpwnam("postgres").pw_uid
    except KeyError:
        return pwd.getpwnam("nobody").pw_uid
