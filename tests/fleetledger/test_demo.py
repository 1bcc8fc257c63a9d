import signal
import sys
from pathlib import Path

from tests.fleetledger.server import STOP_S_MAX, children, started


def test_the_demo_sends_orders_that_robots_finish_and_leaves_nothing_behind(tmp_path: Path) -> None:
    data = tmp_path / "demo"
    command = [sys.executable, "-m", "fleetledger", "demo", "--data", str(data), "--port", "0"]
    command += ["--robots", "3", "--speed", "10", "--orders-per-minute", "12"]

    with started(command, data) as server:
        done = server.until(lambda event: event["type"] == "OrderFinished")
        assert server.found(done["order"])[done["order"]]["status"] == "Done"
        server.process.send_signal(signal.SIGINT)  # Ctrl-C
        assert server.process.wait(STOP_S_MAX) == 0

    assert children(data, server.process.pid) == []
    assert "Fleetledger" in server.log.read_text()
