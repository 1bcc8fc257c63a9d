"""Access of the program as a user starts it: roles of all its calls, the command line, TLS."""

import json
import ssl
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import trustme

from fleetledger.access.roles import _LEAST, _named, is_open, least
from tests.fleetledger.server import START_S_MAX, Server, serving

PASSWORD = "correct horse battery"


def fleetledger(*arguments: str, told: str = "") -> str:
    """Run the command line; gives what it prints."""
    command = [sys.executable, "-m", "fleetledger", "access", *arguments]
    done = subprocess.run(
        command, input=told, capture_output=True, text=True, timeout=START_S_MAX, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server with access control, and an admin `boss` made before its first start."""
    data = tmp_path_factory.mktemp("site") / "data"
    data.mkdir()
    key = fleetledger("key", "add", str(data), "boss", "--role", "admin")
    with serving(data) as server:
        server.client.headers.update({"xyy-app-id": "boss", "xyy-app-key": key})
        yield server


def test_every_call_of_the_server_names_its_least_role(site: Server) -> None:
    paths = site.get("/openapi.json")["paths"]
    assert len(paths) > 20
    unnamed = [
        f"{method.upper()} {path}"
        for path, item in paths.items()
        for method in item
        if least(method.upper(), path) is None and not is_open(path)
    ]
    named = {key for key in _LEAST if key not in _calls(paths)}
    assert not named, f"these calls are named in fleetledger/access/roles.py, and are none: {named}"
    assert not unnamed, f"put these into fleetledger/access/roles.py: {unnamed}"


def _calls(paths: dict[str, Any]) -> set[tuple[str, str]]:
    return {(method.upper(), _named(path)) for path, item in paths.items() for method in item}


def test_roles_may_what_they_may(site: Server) -> None:
    keys = {
        role: fleetledger("key", "add", str(site.data), role, "--role", role)
        for role in ("viewer", "operator")
    }
    site.until(lambda e: e["type"] == "KeyAdded" and e["app"] == "operator")
    calls: tuple[tuple[str, str, dict[str, object]], ...] = (
        ("GET", "/metrics", {}),
        ("POST", "/api/fleet/orders/cancel-all", {"sceneId": "none"}),
        ("POST", "/api/fleet/robots/none/set-soft-emc", {"robotNames": []}),
        ("POST", "/api/fleet/scenes/none/robot/remove", {"robotNames": []}),
        ("POST", "/api/fleet/scenes/none/config", {}),
        ("GET", "/api/access/users", {}),
    )
    refused = {
        role: [
            site.client.request(
                method, path, json=body, headers={"xyy-app-id": role, "xyy-app-key": key}
            ).status_code
            == 403
            for method, path, body in calls
        ]
        for role, key in (keys | {"boss": site.client.headers["xyy-app-key"]}).items()
    }
    assert refused == {
        "viewer": [False, True, True, True, True, True],
        "operator": [False, False, False, True, True, True],
        "boss": [False] * 6,
    }


def test_the_command_line_works_on_a_running_server(site: Server) -> None:
    data = str(site.data)
    fleetledger("user", "add", data, "anna", "--role", "operator", told=PASSWORD + "\n")
    added = site.until(lambda e: e["type"] == "UserAdded" and e["user"] == "anna")
    assert added["by"].startswith("fleetledger-cli (")
    body = {"username": "anna", "password": PASSWORD}
    said = site.client.post("/api/sign-in", json=body).json()
    with httpx.Client(base_url=site.url) as anna:
        anna.headers.update({"x-xzz-qyq": said["userId"], "x-xzz-qyx": said["userToken"]})
        assert anna.get("/api/ping").json()["permissions"] == ["view", "operate"]
        fleetledger("user", "change", data, "anna", "--disable")
        site.until(lambda e: e["type"] == "UserChanged" and e["user"] == "anna")
        assert anna.get("/api/ping").status_code == 401
    assert "anna\toperator\tdisabled" in fleetledger("user", "list", data)
    fleetledger("user", "remove", data, "anna")
    site.until(lambda e: e["type"] == "UserRemoved" and e["user"] == "anna")


def test_a_session_outlives_the_server(tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    fleetledger("user", "add", str(data), "anna", "--role", "admin", told=PASSWORD)
    with serving(data) as server:
        said = server.post("/api/sign-in", {"username": "anna", "password": PASSWORD})
        headers = {"x-xzz-qyq": said["userId"], "x-xzz-qyx": said["userToken"]}
        server.client.get("/api/fleet/scenes/list", headers={"x-xzz-qyx": "wrong"})
        server.kill()
    with serving(data) as server:
        assert server.client.get("/api/ping", headers=headers).json()["id"] == "anna"
        server.client.cookies.clear()
        assert server.client.get("/api/fleet/scenes/list").status_code == 401
        assert server.stop() == 0
    with serving(data) as server:
        events = server.client.get("/api/ledger/events", headers=headers).json()
        refused = [e for e in events if e["type"] == "AccessRefused"]
        assert [(e["caller"], e["code"]) for e in refused] == [("", "errNotSignedIn")]
        assert server.stop() == 0
    assert PASSWORD not in json.dumps(events) + server.log.read_text()


def test_it_speaks_tls_by_the_files_given(tmp_path: Path) -> None:
    authority = trustme.CA()
    issued = authority.issue_cert("127.0.0.1", "localhost")
    cert, key, trusted = (tmp_path / name for name in ("cert.pem", "key.pem", "ca.pem"))
    issued.cert_chain_pems[0].write_to_path(cert)
    issued.private_key_pem.write_to_path(key)
    authority.cert_pem.write_to_path(trusted)
    data = tmp_path / "data"
    data.mkdir()
    fleetledger("user", "add", str(data), "anna", "--role", "admin", told=PASSWORD)

    with serving(data, "--tls-cert", str(cert), "--tls-key", str(key)) as server:
        assert server.url.startswith("https://127.0.0.1:")
        with httpx.Client(base_url=server.url, verify=_trusting(trusted)) as client:
            body = {"username": "anna", "password": PASSWORD}
            answer = client.post("/api/sign-in", json=body)
            assert all("Secure" in c for c in answer.headers.get_list("set-cookie"))
            assert client.get("/api/ping").json()["id"] == "anna"
        with pytest.raises(httpx.HTTPError):
            httpx.get(server.url.replace("https", "http") + "/api/ping")
        assert server.stop() == 0


def _trusting(authority: Path) -> ssl.SSLContext:
    return ssl.create_default_context(cafile=str(authority))


def test_tls_files_that_do_not_fit_are_refused_in_words(tmp_path: Path) -> None:
    nonsense = tmp_path / "cert.pem"
    nonsense.write_text("nonsense")
    command = [sys.executable, "-m", "fleetledger", "serve", "--data", str(tmp_path / "data")]
    for options, words in (
        (["--tls-cert", str(nonsense)], "belong together"),
        (["--tls-cert", str(nonsense), "--tls-key", str(nonsense)], "PEM files"),
    ):
        done = subprocess.run(
            [*command, *options], capture_output=True, text=True, timeout=START_S_MAX, check=False
        )
        assert done.returncode == 2
        assert words in " ".join(done.stderr.split())
        assert "Traceback" not in done.stderr
