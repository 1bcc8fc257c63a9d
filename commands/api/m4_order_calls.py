"""The M4 order calls (spec/m4.md §2), and suspension (spec/protocols.md §1.6)."""

from typing import Any

import msgspec
from fastapi import APIRouter
from starlette.requests import Request

from commands.api.answering import KEY_PARAMETER, Answering, Decide, Ready, nothing
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
    """What each call asks for, and how its answer is worded."""

    def __init__(self, answering: Answering) -> None:
        """Take who answers."""
        self._answering = answering

    def join(self, router: APIRouter) -> None:
        """Add the calls to a router."""
        documented = {"openapi_extra": {"parameters": [KEY_PARAMETER]}, "tags": ["orders"]}
        calls: tuple[tuple[str, Decide[Any], Any], ...] = (
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
        )
        for path, decide, model in calls:
            router.add_api_route(
                f"{BASE}/{path}",
                self._answering.once_durable(decide),
                methods=["POST"],
                response_model=model,
                **documented,  # type: ignore[arg-type]  # FastAPI's keywords
            )

    def create(self, request: Request, body: CreateOrderReq) -> Ready:
        """Create one order in a scene; key locations or steps must be given."""
        command = body.command(self._answering.asked(request))
        return self._answering.ready(
            request,
            command,
            lambda decision: msgspec.json.encode(
                {"orderId": decision.made, "externalId": command.external_id}
            ),
        )

    def add_steps(self, request: Request, body: AddStepsReq) -> Ready:
        """Append steps, in the order given, to an order that is not sealed."""
        command = body.command(self._answering.asked(request))
        return self._answering.ready(request, command, nothing)

    def update_steps(self, request: Request, body: UpdateStepsReq) -> Ready:
        """Change steps that are still Executable; all of them, or none."""
        command = body.command(self._answering.asked(request))
        return self._answering.ready(request, command, nothing)

    def delete_steps(self, request: Request, body: DeleteStepsReq) -> Ready:
        """Delete steps that are still Executable; all of them, or none."""
        command = body.command(self._answering.asked(request))
        return self._answering.ready(request, command, nothing)

    def complete(self, request: Request, body: OrderIdReq) -> Ready:
        """Seal one order: no more steps will come."""
        command = body.command(self._answering.asked(request))
        return self._answering.ready(request, command, nothing)

    def complete_batch(self, request: Request, body: OrderIdsReq) -> Ready:
        """Seal several orders, each on its own."""
        asked = self._answering.asked(request)
        command = SealOrders(id=asked.id, by=asked.by, at_ms=asked.at_ms, orders=body.ids())
        return self._answering.ready(
            request, command, lambda decision: parallel_results(body.orderIds, decision)
        )

    def cancel(self, request: Request, body: CancelOrderReq) -> Ready:
        """Cancel one order; one that is done or cancelled is left alone."""
        command = body.command(self._answering.asked(request))
        return self._answering.ready(request, command, nothing)

    def cancel_batch(self, request: Request, body: OrderIdsReq) -> Ready:
        """Cancel several orders, each on its own; done and cancelled ones are left alone."""
        asked = self._answering.asked(request)
        command = CancelOrders(id=asked.id, by=asked.by, at_ms=asked.at_ms, orders=body.ids())
        return self._answering.ready(
            request, command, lambda decision: parallel_results(body.orderIds, decision)
        )

    def cancel_all(self, request: Request, body: SceneIdReq) -> Ready:
        """Cancel all orders of a scene, those of the system itself included."""
        command = body.command(self._answering.asked(request))
        return self._answering.ready(request, command, nothing)

    def update_priority(self, request: Request, body: UpdatePriorityReq) -> Ready:
        """Set the priority of several orders; all of them, or none."""
        command = body.command(self._answering.asked(request))
        return self._answering.ready(request, command, nothing)

    def retry(self, request: Request, body: OrderIdsReq) -> Ready:
        """Go on with orders that have a fault, each on its own."""
        asked = self._answering.asked(request)
        command = RetryOrders(id=asked.id, by=asked.by, at_ms=asked.at_ms, orders=body.ids())
        return self._answering.ready(
            request, command, lambda decision: parallel_results(body.orderIds, decision)
        )

    def suspend(self, request: Request, body: OrderIdsReq) -> Ready:
        """Hold orders up, each on its own: no robot takes them, or goes on with them."""
        return self._suspend(request, body, suspended=True)

    def unsuspend(self, request: Request, body: OrderIdsReq) -> Ready:
        """Let suspended orders go on, each on its own."""
        return self._suspend(request, body, suspended=False)

    def _suspend(self, request: Request, body: OrderIdsReq, *, suspended: bool) -> Ready:
        asked = self._answering.asked(request)
        command = SuspendOrders(
            id=asked.id, by=asked.by, at_ms=asked.at_ms, orders=body.ids(), suspended=suspended
        )
        return self._answering.ready(
            request, command, lambda decision: parallel_results(body.orderIds, decision)
        )
