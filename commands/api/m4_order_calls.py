"""The M4 order calls (spec/m4.md §2), and suspension (spec/protocols.md §1.6)."""

import msgspec
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from commands.api.answering import KEY_PARAMETER, Answering, nothing
from commands.api.m4_models import ParallelResult, parallel_results
from commands.api.m4_orders import (
    AddStepsReq,
    CancelOrderReq,
    CreateOrderAnswer,
    CreateOrderReq,
    DeleteStepsReq,
    OrderIdReq,
    OrderIdsReq,
    SceneIdReq,
    UpdatePriorityReq,
    UpdateStepsReq,
)
from commands.order_suspension import SuspendOrders
from commands.orders import CancelOrders, RetryOrders, SealOrders

BASE = "/api/fleet/orders"


class OrderCalls:
    """Endpoints that translate, ask, and word the answer."""

    def __init__(self, answering: Answering) -> None:
        """Take who answers."""
        self._answering = answering

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        documented = {"openapi_extra": {"parameters": [KEY_PARAMETER]}, "tags": ["orders"]}
        for path, endpoint, model in (
            ("create", self.create, CreateOrderAnswer),
            ("add-steps", self.add_steps, None),
            ("update-steps", self.update_steps, None),
            ("delete-steps", self.delete_steps, None),
            ("complete-order", self.complete, None),
            ("complete-order-batch", self.complete_batch, dict[str, ParallelResult]),
            ("cancel", self.cancel, None),
            ("cancel-batch", self.cancel_batch, dict[str, ParallelResult]),
            ("cancel-all", self.cancel_all, None),
            ("update-priority-batch", self.update_priority, None),
            ("retry-failed-orders", self.retry, dict[str, ParallelResult]),
            ("set-suspended", self.suspend, dict[str, ParallelResult]),
            ("unset-suspended", self.unsuspend, dict[str, ParallelResult]),
        ):
            router.add_api_route(
                f"{BASE}/{path}",
                endpoint,
                methods=["POST"],
                response_model=model,
                **documented,  # type: ignore[arg-type]  # FastAPI's keywords
            )

    async def create(self, request: Request, body: CreateOrderReq) -> Response:
        """Create one order in a scene; key locations or steps must be given."""
        command = body.command(self._answering.asked(request))
        return await self._answering.answer(
            request,
            command,
            lambda decision: msgspec.json.encode(
                {"orderId": decision.made, "externalId": command.external_id}
            ),
        )

    async def add_steps(self, request: Request, body: AddStepsReq) -> Response:
        """Append steps, in the order given, to an order that is not sealed."""
        command = body.command(self._answering.asked(request))
        return await self._answering.answer(request, command, nothing)

    async def update_steps(self, request: Request, body: UpdateStepsReq) -> Response:
        """Change steps that are still Executable; all of them, or none."""
        command = body.command(self._answering.asked(request))
        return await self._answering.answer(request, command, nothing)

    async def delete_steps(self, request: Request, body: DeleteStepsReq) -> Response:
        """Delete steps that are still Executable; all of them, or none."""
        command = body.command(self._answering.asked(request))
        return await self._answering.answer(request, command, nothing)

    async def complete(self, request: Request, body: OrderIdReq) -> Response:
        """Seal one order: no more steps will come."""
        command = body.command(self._answering.asked(request))
        return await self._answering.answer(request, command, nothing)

    async def complete_batch(self, request: Request, body: OrderIdsReq) -> Response:
        """Seal several orders, each on its own."""
        asked = self._answering.asked(request)
        command = SealOrders(id=asked.id, by=asked.by, at_ms=asked.at_ms, orders=body.ids())
        return await self._answering.answer(
            request, command, lambda decision: parallel_results(body.orderIds, decision)
        )

    async def cancel(self, request: Request, body: CancelOrderReq) -> Response:
        """Cancel one order; one that is done or cancelled is left alone."""
        command = body.command(self._answering.asked(request))
        return await self._answering.answer(request, command, nothing)

    async def cancel_batch(self, request: Request, body: OrderIdsReq) -> Response:
        """Cancel several orders, each on its own; done and cancelled ones are left alone."""
        asked = self._answering.asked(request)
        command = CancelOrders(id=asked.id, by=asked.by, at_ms=asked.at_ms, orders=body.ids())
        return await self._answering.answer(
            request, command, lambda decision: parallel_results(body.orderIds, decision)
        )

    async def cancel_all(self, request: Request, body: SceneIdReq) -> Response:
        """Cancel all orders of a scene, those of the system itself included."""
        command = body.command(self._answering.asked(request))
        return await self._answering.answer(request, command, nothing)

    async def update_priority(self, request: Request, body: UpdatePriorityReq) -> Response:
        """Set the priority of several orders; all of them, or none."""
        command = body.command(self._answering.asked(request))
        return await self._answering.answer(request, command, nothing)

    async def retry(self, request: Request, body: OrderIdsReq) -> Response:
        """Go on with orders that have a fault, each on its own."""
        asked = self._answering.asked(request)
        command = RetryOrders(id=asked.id, by=asked.by, at_ms=asked.at_ms, orders=body.ids())
        return await self._answering.answer(
            request, command, lambda decision: parallel_results(body.orderIds, decision)
        )

    async def suspend(self, request: Request, body: OrderIdsReq) -> Response:
        """Hold orders up, each on its own: no robot takes them, or goes on with them."""
        return await self._suspend(request, body, suspended=True)

    async def unsuspend(self, request: Request, body: OrderIdsReq) -> Response:
        """Let suspended orders go on, each on its own."""
        return await self._suspend(request, body, suspended=False)

    async def _suspend(self, request: Request, body: OrderIdsReq, *, suspended: bool) -> Response:
        asked = self._answering.asked(request)
        command = SuspendOrders(
            id=asked.id, by=asked.by, at_ms=asked.at_ms, orders=body.ids(), suspended=suspended
        )
        return await self._answering.answer(
            request, command, lambda decision: parallel_results(body.orderIds, decision)
        )
