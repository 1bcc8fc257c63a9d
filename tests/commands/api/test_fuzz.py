"""Whatever bytes a stranger sends, the answer is one of ours: never a 500."""

import asyncio
import json
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.commands.api.application import site
from tests.commands.site import BINS, ORDER, R1, SCENE, created, opened, task
from tests.strategies import grid

ORDERS, IN_SCENE = "/api/fleet/orders", f"/api/fleet/scenes/{SCENE}"
ROBOTS = "/api/fleet/robots"
STEP_FIELDS = ("stepIndex", "location", "rbkArgs", "forLoad", "forUnload", "nextStepSameOrder")
ROBOT_FIELDS = (
    *("robotName", "groupId", "tags", "vendor", "selfBinNum", "image", "connectionType"),
    *("robotIp", "robotPortStart", "ssl", "gwAuthId", "simulated", "plusOne", "remark"),
    *("gwAuthSecret", "disabled"),
)
FIELDS = {
    f"{ORDERS}/create": ("sceneId", "externalId", "priority", "keyLocations", "stepFixed", "steps"),
    f"{ORDERS}/add-steps": ("orderId", "steps"),
    f"{ORDERS}/update-steps": ("orderId", "steps"),
    f"{ORDERS}/delete-steps": ("orderId", "stepIds"),
    f"{ORDERS}/complete-order": ("orderId",),
    f"{ORDERS}/complete-order-batch": ("orderIds",),
    f"{ORDERS}/cancel": ("sceneId", "orderId"),
    f"{ORDERS}/cancel-batch": ("orderIds",),
    f"{ORDERS}/cancel-all": ("sceneId",),
    f"{ORDERS}/update-priority-batch": ("orderIds", "priority"),
    f"{ORDERS}/retry-failed-orders": ("orderIds",),
    f"{ORDERS}/set-suspended": ("orderIds",),
    f"{ORDERS}/unset-suspended": ("orderIds",),
    f"{IN_SCENE}/robot/create": ROBOT_FIELDS,
    f"{IN_SCENE}/robot/create/auto-batch": (
        "robotNamePrefix",
        "count",
        "robotIpStart",
        *ROBOT_FIELDS,
    ),
    f"{IN_SCENE}/robot/remove": ("robotNames",),
    f"{IN_SCENE}/robot/update/config": ROBOT_FIELDS,
    f"{IN_SCENE}/robot/update/config/batch": ("robotNames", "config"),
    f"{IN_SCENE}/config": ("dispatchMethod", "cbsHighW", "chargingConfig", "dispatchSort"),
    f"{ROBOTS}/{SCENE}/disabled": ("robotNames", "disabled"),
    f"{ROBOTS}/{SCENE}/clear-bins": ("robotNames",),
    f"{ROBOTS}/off-duty": ("sceneId", "robotNames", "offDuty"),
    f"{ROBOTS}/reconnect": ("sceneId", "robotNames"),
    f"{ROBOTS}/master": ("sceneId", "robotNames", "on"),
    f"{ROBOTS}/cancel-nav": ("sceneId", "robotNames"),
    f"{ROBOTS}/pause-nav": ("sceneId", "robotNames"),
    f"{ROBOTS}/resume-nav": ("sceneId", "robotNames"),
    f"{ROBOTS}/{SCENE}/clear-alarm": ("robotNames",),
    f"{ROBOTS}/{SCENE}/set-soft-emc": ("robotNames", "enable"),
    f"{ROBOTS}/{SCENE}/auto-recovery": ("robotNames",),
    "/api/fleet/scenes/import": tuple(type(grid()).__struct_fields__),
}

scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 5),
    st.integers(),
    st.floats(),
    st.text(max_size=6),
    st.sampled_from((SCENE, ORDER, R1, "AP110", *BINS, "10.0.0.1", "Seer", "GwWs", "\ud800", "\0")),
)
anything = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.text(max_size=4), inner, max_size=3),
        st.fixed_dictionaries({}, optional=dict.fromkeys(STEP_FIELDS, inner)),
        st.fixed_dictionaries({}, optional=dict.fromkeys(ROBOT_FIELDS, inner)),
    ),
    max_leaves=8,
)


@st.composite
def calls(draw: st.DrawFn) -> tuple[str, bytes, dict[str, str]]:
    path = draw(st.sampled_from(sorted(FIELDS)))
    body: Any = draw(
        st.one_of(
            st.fixed_dictionaries({}, optional=dict.fromkeys(FIELDS[path], anything)),
            anything,
        )
    )
    key = draw(st.sampled_from((None, None, "k", "", "\u00e9")))
    headers = {} if key is None else {"Idempotency-Key": key.encode("latin-1")}
    raw = draw(st.one_of(st.just(json.dumps(body).encode()), st.binary(max_size=20)))
    return path, raw, headers


@settings(max_examples=100, deadline=None)
@given(st.lists(calls(), min_size=1, max_size=4))
def test_no_body_is_ever_answered_by_a_failure(made: list[tuple[str, bytes, Any]]) -> None:
    there = site(*opened(R1), created(ORDER, task(), sealed=False))

    async def call_all() -> None:
        async with there.client() as client:
            for path, raw, headers in made:
                answer = await client.post(path, content=raw, headers=headers)
                assert answer.status_code in (200, 400)
                if answer.status_code == 400:
                    assert answer.json().keys() == {"code", "message", "args"}

    asyncio.run(call_all())
