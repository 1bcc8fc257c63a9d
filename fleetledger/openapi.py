"""The OpenAPI document: what FastAPI finds, made true to the gate and filled with examples."""

import json
from functools import cache
from pathlib import Path
from typing import Any

from fastapi.routing import APIRoute

from fleetledger.access.callers import APP_ID_HEADER, APP_KEY_HEADER, TOKEN_HEADER, USER_HEADER
from fleetledger.http import ErrorBody
from replay.api import OWN_PARTS

EXAMPLES = Path(__file__).parent / "examples"  # the specification's own, file by file

# what each group of examples is of (spec/examples/README.md): its files begin with the key
EXAMPLES_OF = {
    "orders-create": "/api/fleet/orders/create",
    "orders-add-steps": "/api/fleet/orders/add-steps",
    "orders-update-steps": "/api/fleet/orders/update-steps",
    "orders-delete-steps": "/api/fleet/orders/delete-steps",
    "orders-complete": "/api/fleet/orders/complete-order",
    "orders-complete-batch": "/api/fleet/orders/complete-order-batch",
    "orders-cancel": "/api/fleet/orders/cancel",
    "orders-cancel-batch": "/api/fleet/orders/cancel-batch",
    "orders-cancel-all": "/api/fleet/orders/cancel-all",
    "orders-update-priority-batch": "/api/fleet/orders/update-priority-batch",
    "orders-retry-failed": "/api/fleet/orders/retry-failed-orders",
    "orders-query-detail": "/api/fleet/orders/query-order-detail",
    "entity-find-many": "/api/entity/find/many",
    "entity-find-page": "/api/entity/find/page",
    "robots-create": "/api/fleet/scenes/{sceneId}/robot/create",
    "robots-create-batch": "/api/fleet/scenes/{sceneId}/robot/create/batch",
    "robots-create-auto-batch": "/api/fleet/scenes/{sceneId}/robot/create/auto-batch",
    "robots-remove": "/api/fleet/scenes/{sceneId}/robot/remove",
    "robots-update-config": "/api/fleet/scenes/{sceneId}/robot/update/config",
    "robots-update-config-batch": "/api/fleet/scenes/{sceneId}/robot/update/config/batch",
    "robots-reconnect": "/api/fleet/robots/reconnect",
    "robots-off-duty": "/api/fleet/robots/off-duty",
    "robots-all": "/api/fleet/robots/all-all",
    "robots-master": "/api/fleet/robots/master",
    "robots-query-point": "/api/fleet/robots/query-point",
    "robots-maps": "/api/fleet/robots/{sceneId}/maps/{robotName}",
    "robots-clear-alarm": "/api/fleet/robots/{sceneId}/clear-alarm",
    "robots-set-soft-emc": "/api/fleet/robots/{sceneId}/set-soft-emc",
    "robots-disabled": "/api/fleet/robots/{sceneId}/disabled",
    "robots-auto-recovery": "/api/fleet/robots/{sceneId}/auto-recovery",
    "external-map-res-request": "/api/fleet/external-map-res/request",
    "external-map-res-release": "/api/fleet/external-map-res/release",
    "external-map-res-release-by-owner": "/api/fleet/external-map-res/release-by-owner",
}

_REFUSALS = {
    "400": "Wrong input: nothing happened",
    "401": "Nobody is signed in",
    "403": "The caller's role may not do this",
    "429": "Too often: try again after `Retry-After` seconds",
    "503": "The server cannot do this now",
    "504": "It took too long",
}
_REPLAY = "/api/replay/"  # its calls say 404 for what was not there at the moment


def operation_id(route: APIRoute) -> str:
    """Name an operation after its path, so that generated clients read well."""
    words = [w for w in route.path.removeprefix("/api").split("/") if w and "{" not in w]
    name = "_".join(words).replace("-", "_") or "console"
    return f"get_{name}" if "GET" in (route.methods or ()) else name


def completed(document: dict[str, Any]) -> dict[str, Any]:
    """Say what the gate does, and give every operation its sentence, errors and examples."""
    components = document.setdefault("components", {})
    schemas = components.setdefault("schemas", {})
    schemas["ErrorBody"] = ErrorBody.model_json_schema()
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    components["securitySchemes"] = {
        "appId": {"type": "apiKey", "in": "header", "name": APP_ID_HEADER},
        "appKey": {"type": "apiKey", "in": "header", "name": APP_KEY_HEADER},
        "userId": {"type": "apiKey", "in": "header", "name": USER_HEADER},
        "userToken": {"type": "apiKey", "in": "header", "name": TOKEN_HEADER},
    }
    document["security"] = [{"appId": [], "appKey": []}, {"userId": [], "userToken": []}]
    groups = {path: group for group, path in EXAMPLES_OF.items()}
    for path, item in document["paths"].items():
        for operation in item.values():
            schemas |= operation["responses"].get("200", {}).pop(OWN_PARTS, {})
            _speak(operation)
            _refuse(operation, "404" if path.startswith(_REPLAY) else None)
            if path in groups:
                _exemplify(operation, groups[path])
    _simplify_tuples(document)
    return document


def _simplify_tuples(schema: Any) -> None:
    """Spell tuples of one type, such as corners, as arrays: tools stumble over `prefixItems`."""
    if isinstance(schema, dict):
        parts = schema.get("prefixItems")
        if isinstance(parts, list) and all(part == parts[0] for part in parts):
            del schema["prefixItems"]
            schema["items"] = parts[0]
        for inner in schema.values():
            _simplify_tuples(inner)
    elif isinstance(schema, list):
        for inner in schema:
            _simplify_tuples(inner)


def _speak(operation: dict[str, Any]) -> None:
    """Let the first line of the endpoint's docstring be its summary, and say where no body is."""
    operation["summary"] = operation.get("description", "").split("\n")[0].rstrip(".")
    done = operation["responses"].get("200")
    if done is not None and done.get("content") == {"application/json": {"schema": {}}}:
        operation["responses"]["200"] = {"description": "Done; there is no body"}


def _refuse(operation: dict[str, Any], missing: str | None) -> None:
    schema = {"schema": {"$ref": "#/components/schemas/ErrorBody"}}
    responses = operation["responses"]
    responses.pop("422", None)
    wanted = dict(_REFUSALS)
    if "requestBody" in operation:
        wanted["413"] = "Body too large"
    if missing is not None:
        wanted[missing] = "It was not there at that moment"
    for status, words in wanted.items():
        content = {"application/json": dict(schema)}
        responses.setdefault(status, {"description": words, "content": content})


def _exemplify(operation: dict[str, Any], group: str) -> None:
    asked, answered = examples(group, "request"), examples(group, "response")
    if group == "external-map-res-request":
        refused = answered.pop("example-3")
        operation["responses"]["400"]["content"]["application/json"]["examples"] = {
            "refused": refused
        }
    if asked and "requestBody" in operation:
        operation["requestBody"]["content"]["application/json"]["examples"] = asked
    if answered:
        content = operation["responses"]["200"].setdefault("content", {})
        content.setdefault("application/json", {})["examples"] = answered


@cache
def examples(group: str, side: str) -> dict[str, dict[str, Any]]:
    """Read the examples of a call by their numbers; the first has none in its file's name."""
    found = {}
    for path in sorted(EXAMPLES.glob(f"{group}*.{side}.json")):
        number = path.name.removeprefix(group).removesuffix(f"{side}.json").strip(".")
        if number == "" or number.isdecimal():
            found[f"example-{number or 1}"] = {"value": json.loads(path.read_text())}
    return dict(sorted(found.items()))
