from collections.abc import Sequence

import httpx
import pytest
from fastapi import FastAPI

import projections.api.callbacks
from fleetledger.http import ThinRoute, install_errors
from ledger.callbacks import CallbackStatus
from ledger.events import SceneRemoved
from ledger.ids import OrderId, SceneId
from projections.callbacks import Callback
from tests.commands.site import SCENE, opened
from tests.scenario import happened


def waits(
    number: int, url: str = "http://a/", scene: SceneId = SCENE, **fields: object
) -> Callback:
    made = {
        "number": number,
        "id": f"{number:032}",
        "scene": scene,
        "url": url,
        "order": OrderId(f"O{number}"),
        "status": CallbackStatus.DONE,
        "position": 100 + number,
        "at_ms": 1000 + number,
        "retries_max": 3,
        "retry_s": 1.0,
        "body": b"{}",
    }
    return Callback(**(made | fields))  # type: ignore[arg-type]


async def asked(
    scene: str, waiting: Sequence[Callback], *past: object, behind: int = 0
) -> httpx.Response:
    app = FastAPI()
    install_errors(app)
    fleet = happened([*opened(), *past])  # type: ignore[list-item]
    router = projections.api.callbacks.router(
        fleet.scenes.get, lambda: list(waiting), lambda: behind, ThinRoute
    )
    app.include_router(router)
    transport = httpx.ASGITransport(app=app)
    async with httpx.AsyncClient(transport=transport, base_url="http://site") as client:
        return await client.get(f"/api/fleet/scenes/{scene}/callbacks/waiting")


async def test_nothing_waits_at_first() -> None:
    answer = await asked(SCENE, [])
    assert answer.json() == {"count": 0, "behind": 0, "urls": []}


async def test_each_address_has_its_count_and_its_oldest() -> None:
    failing = waits(2, "http://b/", tries=4, error="HTTP 500")
    others = waits(1), waits(3), waits(4, "http://b/"), waits(5, scene=SceneId("other"))
    answer = await asked(SCENE, [others[0], failing, *others[1:]], behind=7)
    assert answer.json() == {
        "count": 4,
        "behind": 7,
        "urls": [
            {
                "url": "http://a/",
                "count": 2,
                "failing": 0,
                "oldest": {
                    "id": f"{1:032}",
                    "orderId": "O1",
                    "status": "Done",
                    "at": 1001,
                    "position": 101,
                    "tries": 0,
                    "lastError": None,
                },
            },
            {
                "url": "http://b/",
                "count": 2,
                "failing": 1,
                "oldest": {
                    "id": f"{2:032}",
                    "orderId": "O2",
                    "status": "Done",
                    "at": 1002,
                    "position": 102,
                    "tries": 4,
                    "lastError": "HTTP 500",
                },
            },
        ],
    }


@pytest.mark.parametrize(
    ("scene", "past", "code"),
    [
        ("no", (), "errSceneNotFound"),
        ("%20", (), "errSceneIdBlank"),
        (SCENE, (SceneRemoved(scene=SCENE),), "errSceneNotFound"),
    ],
)
async def test_a_scene_that_is_not_there_is_refused(
    scene: str, past: tuple[object, ...], code: str
) -> None:
    answer = await asked(scene, [], *past)
    assert (answer.status_code, answer.json()["code"]) == (400, code)
