"""The OpenAPI document is complete, its examples are true, and it suffices to drive the server."""

import importlib.util
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from jsonschema_rs import Draft202012Validator

from fleetledger.openapi import EXAMPLES_OF, examples
from tests.fleetledger.server import Server, order_body, serving, small_file, small_scene
from tests.golden import folder

OWN = ("/api/ledger/", "/api/replay/")  # shapes of the program itself, documented in docs/
OWN_SHAPE = "Own"  # their names say what they are, units included
ERRORS = {"400", "401", "403", "429", "503", "504"}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    made = tmp_path_factory.mktemp("openapi")
    options = ("--auth", "none", "--simulate", "--speed", "20")
    with serving(made / "data", *options, "--scene", str(small_scene(made))) as server:
        yield server


@pytest.fixture(scope="module")
def document(server: Server) -> dict[str, Any]:
    found: dict[str, Any] = server.get("/openapi.json")
    return found


def operations(document: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    return [(path, op) for path, item in document["paths"].items() for op in item.values()]


def test_every_operation_says_what_it_does_and_how_it_refuses(document: dict[str, Any]) -> None:
    assert document["openapi"].startswith("3.1")
    names = [operation["operationId"] for _, operation in operations(document)]
    assert len(set(names)) == len(names)
    for path, operation in operations(document):
        assert operation["summary"] and operation["description"], path
        assert operation["tags"], path
        missing = ERRORS - operation["responses"].keys()
        assert not missing, (path, missing)
        done = operation["responses"]["200"]
        content = done.get("content", {})
        assert content or done["description"] == "Done; there is no body", path
        for kind, said in content.items():
            if kind == "application/json":
                assert said.get("schema"), f"{path} does not say what it answers"


def undescribed(schema: Any, where: str) -> Iterator[str]:
    if isinstance(schema, dict):
        for name, field in schema.get("properties", {}).items():
            if "description" not in field:
                yield f"{where}.{name}"
        for key, inner in schema.items():
            yield from undescribed(inner, f"{where}/{key}")
    elif isinstance(schema, list):
        for inner in schema:
            yield from undescribed(inner, where)


def test_every_field_is_described(document: dict[str, Any]) -> None:
    schemas = document["components"]["schemas"]
    found = list(undescribed({k: v for k, v in schemas.items() if not k.startswith(OWN_SHAPE)}, ""))
    for path, operation in operations(document):
        found += [f"{path} {p['name']}" for p in operation.get("parameters", ())
                  if not p.get("description")]  # fmt: skip
        if not path.startswith(OWN):
            found += undescribed(operation, path)
    assert not found, found


def test_the_examples_are_the_specifications_own() -> None:
    original = folder("m4")
    for path in sorted(original.glob("*.json")):
        kept = Path(sys.modules["fleetledger.openapi"].__file__ or "").parent / "examples"
        assert json.loads((kept / path.name).read_text()) == json.loads(path.read_text())


@pytest.mark.parametrize("group", sorted(EXAMPLES_OF))
def test_every_example_fits_the_schema_that_stands_beside_it(
    document: dict[str, Any], group: str
) -> None:
    path = EXAMPLES_OF[group]
    operation = next(iter(document["paths"][path].values()))
    shown = 0
    for side, content in (
        ("request", operation.get("requestBody", {}).get("content", {})),
        ("response", operation["responses"]["200"].get("content", {})),
    ):
        said = content.get("application/json", {})
        for name, example in said.get("examples", {}).items():
            schema = {**said["schema"], "components": document["components"]}
            Draft202012Validator(schema).validate(example["value"])
            assert example in examples(group, side).values(), name
            shown += 1
    assert shown or not (examples(group, "request") or examples(group, "response"))


def generated(document: dict[str, Any], target: Path) -> ModuleType:
    """Generate a client package from the document alone, and import it."""
    source = target / "openapi.json"
    source.write_text(json.dumps(document))
    config = target / "config.yml"
    config.write_text("post_hooks: []\n")
    package = target / "fleet_client"
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none"]
    command += ["--path", str(source), "--output-path", str(package), "--config", str(config)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "unable" not in done.stderr.lower(), done.stderr
    spec = importlib.util.spec_from_file_location(
        "fleet_client", package / "__init__.py", submodule_search_locations=[str(package)]
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fleet_client"] = module
    spec.loader.exec_module(module)
    return module


def test_a_client_generated_from_the_document_drives_the_server(
    server: Server, document: dict[str, Any], tmp_path: Path
) -> None:
    client = generated(document, tmp_path).Client(base_url=server.url)

    def call(tag: str, name: str, **arguments: Any) -> Any:
        module = importlib.import_module(f"fleet_client.api.{tag}.{name}")
        return module.sync_detailed(client=client, **arguments)

    def model(name: str, body: dict[str, Any]) -> Any:
        models = importlib.import_module("fleet_client.models")
        return getattr(models, name).from_dict(body)

    bins = [str(b.name) for b in small_file().areas[0].bins]
    wanted = order_body(server.scene, bins[0], bins[1])
    made = call("orders", "fleet_orders_create", body=model("CreateOrderReq", wanted))
    assert made.status_code == 200
    server.until_finished(made.parsed.order_id)
    detail = call("m4", "get_fleet_orders_query_order_detail", order_id=made.parsed.order_id)
    assert detail.parsed.status == "Done"
    assert [step.location for step in detail.parsed.steps] == bins[:2]
    page = {"entityName": "TransportOrder", "pageNo": 1, "pageSize": 5}
    found = call("m4", "entity_find_page", body=model("PageAsked", page))
    assert made.parsed.order_id in {row.id for row in found.parsed.page}
    # all-all's field `d` is too much for this generator, which calls its own variable so
    robot = small_file().robots[0].name
    at = call("m4", "get_fleet_robots_query_point", scene_id=server.scene, robot_name=robot)
    assert (at.status_code, isinstance(at.parsed.x, float)) == (200, True)
    off = model("UpdateOffDutyReq", {"sceneId": server.scene, "robotNames": [robot, "nobody"]})
    results = call("robots", "fleet_robots_off_duty", body=off).parsed.additional_properties
    assert (results[robot].ok, results["nobody"].ok) == (True, False)
    refused = call(
        "orders", "fleet_orders_create", body=model("CreateOrderReq", wanted | {"sceneId": "none"})
    )
    assert (refused.status_code, refused.parsed.code) == (400, "errSceneNotFound")
    client.get_httpx_client().close()


# what changes nothing in the fleet: questions, and access, whose answers hold secrets
NO_COMMANDS = ("/api/entity/", "/api/sign-", "/api/access/", "/api/replay/", "/api/sql")
QUESTIONS = ("/query-all", "/calc-move-costs")


def test_every_command_takes_an_idempotency_key(document: dict[str, Any]) -> None:
    posts = {path: item["post"] for path, item in document["paths"].items() if "post" in item}
    taking = {
        path
        for path, operation in posts.items()
        if "Idempotency-Key" in [p["name"] for p in operation.get("parameters", ())]
    }
    asking = {path for path in posts if path.startswith(NO_COMMANDS) or path.endswith(QUESTIONS)}
    assert posts.keys() - asking == taking
    for path, item in document["paths"].items():
        assert not item.keys() & {"put", "patch", "delete"}, f"{path}: a command by another method"
