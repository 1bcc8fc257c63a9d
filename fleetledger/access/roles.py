"""Who may do what: the least role of every call. What is not in here is for admins only."""

import re
from collections.abc import Iterable

from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute, compile_path

from ledger.events import Role

RANK = {Role.VIEWER: 1, Role.OPERATOR: 2, Role.ADMIN: 3}
OPEN = 0  # of calls that tell nothing of the plant, or that sign in

OPEN_PATHS = frozenset({"/", "/favicon.ico", "/docs", "/redoc", "/openapi.json", "/api/sign-in"})
OPEN_FOLDERS = ("/console/", "/docs/", "/static-offline-docs/")

VIEWER = """
GET  /api/ping
POST /api/sign-out
POST /api/access/password
GET  /metrics
POST /api/entity/find/many
POST /api/entity/find/page
POST /api/entity/find/one
POST /api/entity/find/count
POST /api/entity/find/batch
GET  /api/fleet/orders/query-order-detail
GET  /api/fleet/robots/all-all
GET  /api/fleet/robots/query-point
GET  /api/fleet/robots/{sceneId}/maps/{robotName}
GET  /api/fleet/scenes/list
GET  /api/fleet/scenes/schema/{sceneId}
GET  /api/fleet/scenes/{sceneId}/map
GET  /api/fleet/scenes/{sceneId}/config
GET  /api/fleet/scenes/{sceneId}/ready-status
GET  /api/fleet/scenes/{sceneId}/list-points-bins
GET  /api/fleet/scenes/{sceneId}/door
GET  /api/fleet/scenes/{sceneId}/lift
POST /api/fleet/scenes/{sceneId}/calc-move-costs
POST /api/fleet/scenes/{sceneId}/query-all
GET  /api/ledger/position
GET  /api/ledger/events
POST /api/sql
GET  /api/ledger/state
GET  /api/replay/frame
GET  /api/replay/map
GET  /api/replay/waits
GET  /api/replay/order-story
"""

OPERATOR = """
POST /api/fleet/orders/create
POST /api/fleet/orders/add-steps
POST /api/fleet/orders/update-steps
POST /api/fleet/orders/delete-steps
POST /api/fleet/orders/complete-order
POST /api/fleet/orders/complete-order-batch
POST /api/fleet/orders/cancel
POST /api/fleet/orders/cancel-batch
POST /api/fleet/orders/cancel-all
POST /api/fleet/orders/update-priority-batch
POST /api/fleet/orders/retry-failed-orders
POST /api/fleet/orders/set-suspended
POST /api/fleet/orders/unset-suspended
POST /api/fleet/robots/reconnect
POST /api/fleet/robots/off-duty
POST /api/fleet/robots/master
POST /api/fleet/robots/cancel-nav
POST /api/fleet/robots/pause-nav
POST /api/fleet/robots/resume-nav
POST /api/fleet/robots/{sceneId}/clear-alarm
POST /api/fleet/robots/{sceneId}/set-soft-emc
POST /api/fleet/robots/{sceneId}/disabled
POST /api/fleet/robots/{sceneId}/auto-recovery
POST /api/fleet/robots/{sceneId}/clear-bins
POST /api/fleet/external-map-res/request
POST /api/fleet/external-map-res/release
POST /api/fleet/external-map-res/release-by-owner
POST /api/fleet/external-map-res/release-all
POST /api/fleet/devices/doors/open-batch
POST /api/fleet/devices/doors/close-batch
POST /api/fleet/devices/doors/keep-open
POST /api/fleet/devices/lifts/keep-open
POST /api/fleet/devices/lifts/cancel-open
POST /api/fleet/scenes/{sceneId}/dispatch-pause
GET  /api/fleet/scenes/{sceneId}/callbacks/waiting
"""

ADMIN = """
POST /api/fleet/scenes/import
POST /api/fleet/scenes/create
POST /api/fleet/scenes/remove
POST /api/fleet/scenes/{sceneId}/disable
POST /api/fleet/scenes/{sceneId}/basic/patch
POST /api/fleet/scenes/{sceneId}/config
POST /api/fleet/scenes/{sceneId}/config/patch
GET  /api/fleet/scenes/{sceneId}/callbacks
POST /api/fleet/scenes/{sceneId}/callbacks
POST /api/fleet/scenes/{sceneId}/robot/create
POST /api/fleet/scenes/{sceneId}/robot/create/batch
POST /api/fleet/scenes/{sceneId}/robot/create/auto-batch
POST /api/fleet/scenes/{sceneId}/robot/remove
POST /api/fleet/scenes/{sceneId}/robot/update/config
POST /api/fleet/scenes/{sceneId}/robot/update/config/batch
GET  /api/access/users
POST /api/access/users/add
POST /api/access/users/update
POST /api/access/users/remove
GET  /api/access/keys
POST /api/access/keys/add
POST /api/access/keys/rotate
POST /api/access/keys/remove
"""


def _named(path: str) -> str:
    """Leave out how parameters are called."""
    return re.sub(r"{[^}]*}", "{}", path)


_LEAST: dict[tuple[str, str], Role] = {
    (method, _named(path)): role
    for role, calls in ((Role.VIEWER, VIEWER), (Role.OPERATOR, OPERATOR), (Role.ADMIN, ADMIN))
    for method, path in (line.split() for line in calls.split("\n") if line)
}


def least(method: str, path: str) -> Role | None:
    """Give the least role for a route by its template; None = the table has no such call."""
    return _LEAST.get((method, _named(path)))


def is_open(path: str) -> bool:
    """Tell whether anybody may call it."""
    return path in OPEN_PATHS or path.startswith(OPEN_FOLDERS)


class Policy:
    """The rank that each call of an application needs."""

    def __init__(self, routes: Iterable[BaseRoute]) -> None:
        """Take the routes; whatever of them is not in the table is for admins."""
        self._exact: dict[tuple[str, str], int] = {}
        self._patterns: list[tuple[re.Pattern[str], str, int]] = []
        for route in routes:
            if isinstance(route, WebSocketRoute) or (isinstance(route, Mount) and _opens(route)):
                continue  # a WebSocket's endpoint refuses by itself
            # whatever else is nested would be open to every viewer, unseen
            assert isinstance(route, Route), f"{route} is no plain route: hand its routes over"
            for method in route.methods or ():
                rank = _rank(method, route.path)
                if "{" in route.path:
                    self._patterns.append((compile_path(route.path)[0], method, rank))
                else:
                    self._exact[(method, route.path)] = rank

    def rank(self, method: str, path: str) -> int:
        """Give the least rank of a call; of one that there is not, that of a known caller."""
        found = self._exact.get((method, path))
        if found is not None:
            return found
        if is_open(path):
            return OPEN
        ranks = [
            rank
            for pattern, of_method, rank in self._patterns
            if of_method == method and pattern.match(path)
        ]
        return max(ranks, default=RANK[Role.VIEWER])  # then the application says that it is none


def _opens(mount: Mount) -> bool:
    return is_open(f"{mount.path}/")


def _rank(method: str, path: str) -> int:
    if is_open(path):
        return OPEN
    role = least("GET" if method == "HEAD" else method, path)
    return RANK[role or Role.ADMIN]
