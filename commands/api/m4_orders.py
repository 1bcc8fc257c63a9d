"""Wire models of the M4 order calls, and what they ask for (spec/m4.md §2)."""

from typing import Annotated, Any

from pydantic import BaseModel, Field

from commands.api.answering import Asked
from commands.api.m4_models import Int, Text, Wire, json_text
from commands.orders import (
    BATCH_ORDERS_MAX,
    EXTERNAL_ID_CHARS_MAX,
    KEY_LOCATIONS_MAX,
    STEPS_MAX,
    WANTED_MAX,
    CancelAllOrders,
    CancelOrder,
    CreateOrder,
    PrioritiseOrders,
    SealOrder,
)
from commands.steps import AddSteps, ChangeSteps, DeleteSteps, StepPatch
from ledger.ids import OrderId, RobotName, SceneId, StepId
from ledger.state import StepTask

_LOCATION = "Work location: a point or a bin of the scene; a bin where a `binTask` is done."
_ARGUMENTS = (
    'Action arguments: null or {} for none, `{"binTask": name}` for a task of the bin, '
    '`{"operation": name}` for what the robot itself knows.'
)


class CreateStepReq(Wire):
    """A new step."""

    location: Text = Field(description=_LOCATION, examples=["AP110"])
    rbkArgs: dict[str, Any] | None = Field(None, description=_ARGUMENTS)
    forLoad: bool | None = Field(False, description="After this step the robot is loaded.")
    forUnload: bool | None = Field(False, description="Put down here; not both, and load.")
    withdrawOrderAllowed: bool | None = Field(
        False, description="The order may go to another robot while this step is next."
    )
    nextStepSameOrder: bool | None = Field(
        False, description="The robot's next step must be of this order too."
    )

    def task(self, field: str) -> StepTask:
        """Translate; `field` says where it stands in the request."""
        arguments = json_text(self.rbkArgs, f"{field}.rbkArgs") if self.rbkArgs else None
        return StepTask(
            location=self.location,
            arguments=arguments,
            loads=self.forLoad is True,
            unloads=self.forUnload is True,
            withdrawable=self.withdrawOrderAllowed is True,
            keeps_robot=self.nextStepSameOrder is True,
        )


def _tasks(steps: list[CreateStepReq] | None) -> tuple[StepTask, ...]:
    return tuple(step.task(f"steps[{n}]") for n, step in enumerate(steps or ()))


NewSteps = Annotated[list[CreateStepReq], Field(max_length=STEPS_MAX)]


class CreateOrderReq(Wire):
    """A new order."""

    sceneId: Text = Field(description="Scene that the order belongs to.")
    externalId: str | None = Field(
        None, description=f"The caller's own text, {EXTERNAL_ID_CHARS_MAX} characters at most."
    )
    priority: Int | None = Field(0, description="Larger = more important.")
    expectedRobotNames: Annotated[list[Text], Field(max_length=WANTED_MAX)] | None = Field(
        None, description="Robots that may execute it; none = any. With groups: either fits."
    )
    expectedRobotGroups: Annotated[list[Text], Field(max_length=WANTED_MAX)] | None = Field(
        None, description="Robot groups that may execute it, by name; none = any."
    )
    containerId: Text | None = Field(
        None, description="Container; `container-<orderId>` for loads that name none."
    )
    containerTypeName: Text | None = Field(None, description="A container type of the scene.")
    containerDir: float | None = Field(
        None, allow_inf_nan=False, description="Direction of the goods set down, world, rad."
    )
    keyLocations: Annotated[list[Text], Field(max_length=KEY_LOCATIONS_MAX)] | None = Field(
        None, description="Points or bins by which it is assigned; required without steps."
    )
    stepFixed: bool | None = Field(False, description="Sealed: no step can be added any more.")
    steps: NewSteps | None = Field(None, description="Steps in travel order.")

    def command(self, asked: Asked) -> CreateOrder:
        """Translate; an empty list is an absent one (C31), and so is an empty name."""
        return CreateOrder(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=SceneId(self.sceneId),
            external_id=self.externalId,
            priority=self.priority or 0,
            wanted_robots=tuple(map(RobotName, self.expectedRobotNames or ())),
            wanted_groups=tuple(self.expectedRobotGroups or ()),
            container=self.containerId or None,
            container_type=self.containerTypeName or None,
            container_heading_rad=self.containerDir,
            key_locations=tuple(self.keyLocations or ()),
            sealed=self.stepFixed is True,
            tasks=_tasks(self.steps),
        )


class CreateOrderAnswer(BaseModel):
    """The new order."""

    orderId: str = Field(description="Id of the new order.", examples=["TO20250806-000025"])
    externalId: str | None = Field(description="As in the request.")


class AddStepsReq(Wire):
    """Steps to be appended."""

    orderId: Text = Field(description="An order that is not sealed.")
    steps: NewSteps = Field(description="New steps, in travel order.")

    def command(self, asked: Asked) -> AddSteps:
        """Translate."""
        return AddSteps(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            order=OrderId(self.orderId),
            tasks=_tasks(self.steps),
        )


class UpdateStepReq(Wire):
    """New values of one step; what is absent or null stays."""

    stepIndex: Int = Field(description="Position in the order, from 0.")
    location: Text | None = Field(None, description=_LOCATION)
    rbkArgs: dict[str, Any] | None = Field(None, description=_ARGUMENTS + " Here null = as is.")
    forLoad: bool | None = Field(None, description="After this step the robot is loaded.")
    forUnload: bool | None = Field(None, description="Put down here; not both, and load.")
    withdrawOrderAllowed: bool | None = Field(None, description="As in a new step.")
    nextStepSameOrder: bool | None = Field(None, description="As in a new step.")

    def patch(self, field: str) -> StepPatch:
        """Translate; `field` says where it stands in the request."""
        arguments = None if self.rbkArgs is None else json_text(self.rbkArgs, f"{field}.rbkArgs")
        return StepPatch(
            step=self.stepIndex,
            location=self.location,
            arguments=arguments,
            loads=self.forLoad,
            unloads=self.forUnload,
            withdrawable=self.withdrawOrderAllowed,
            keeps_robot=self.nextStepSameOrder,
        )


class UpdateStepsReq(Wire):
    """Changes to steps in state Executable."""

    orderId: Text = Field(description="An order that is not finished.")
    steps: Annotated[list[UpdateStepReq], Field(max_length=STEPS_MAX)] = Field(
        description="What changes; each step once."
    )

    def command(self, asked: Asked) -> ChangeSteps:
        """Translate."""
        return ChangeSteps(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            order=OrderId(self.orderId),
            patches=tuple(step.patch(f"steps[{n}]") for n, step in enumerate(self.steps)),
        )


class DeleteStepsReq(Wire):
    """Steps to be taken out."""

    orderId: Text = Field(description="An order that is not finished.")
    stepIds: Annotated[list[Text], Field(max_length=STEPS_MAX)] = Field(
        description="Ids, not indexes, of steps in state Executable."
    )

    def command(self, asked: Asked) -> DeleteSteps:
        """Translate."""
        return DeleteSteps(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            order=OrderId(self.orderId),
            steps=tuple(map(StepId, self.stepIds)),
        )


class OrderIdReq(Wire):
    """One order."""

    orderId: Text = Field(description="Order id.")

    def command(self, asked: Asked) -> SealOrder:
        """Translate."""
        return SealOrder(id=asked.id, by=asked.by, at_ms=asked.at_ms, order=OrderId(self.orderId))


OrderIds = Annotated[list[Text], Field(max_length=BATCH_ORDERS_MAX)]


class OrderIdsReq(Wire):
    """Several orders."""

    orderIds: OrderIds = Field(description="Order ids.")

    def ids(self) -> tuple[OrderId, ...]:
        """Translate."""
        return tuple(map(OrderId, self.orderIds))


class CancelOrderReq(Wire):
    """One order of a scene."""

    sceneId: Text = Field(description="Scene that the order belongs to.")
    orderId: Text = Field(description="Order id.")

    def command(self, asked: Asked) -> CancelOrder:
        """Translate."""
        return CancelOrder(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            scene=SceneId(self.sceneId),
            order=OrderId(self.orderId),
        )


class SceneIdReq(Wire):
    """One scene."""

    sceneId: Text = Field(description="Scene id.")

    def command(self, asked: Asked) -> CancelAllOrders:
        """Translate."""
        return CancelAllOrders(
            id=asked.id, by=asked.by, at_ms=asked.at_ms, scene=SceneId(self.sceneId)
        )


class UpdatePriorityReq(Wire):
    """One priority for several orders."""

    orderIds: OrderIds = Field(description="Orders that are not finished.")
    priority: Int = Field(description="Larger = more important.")

    def command(self, asked: Asked) -> PrioritiseOrders:
        """Translate."""
        return PrioritiseOrders(
            id=asked.id,
            by=asked.by,
            at_ms=asked.at_ms,
            orders=tuple(map(OrderId, self.orderIds)),
            priority=self.priority,
        )
