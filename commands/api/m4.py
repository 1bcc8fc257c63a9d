"""The write side of the M4 dialect."""

from fastapi import APIRouter
from fastapi.routing import APIRoute

from commands.api.answering import Answering, Durable
from commands.api.m4_devices import DeviceCalls
from commands.api.m4_order_calls import OrderCalls
from commands.api.m4_resources import ResourceCalls, Watch
from commands.api.m4_robot_calls import KeepSecrets, RobotCalls
from commands.api.m4_robot_instructions import InstructionCalls
from commands.handle import Handler


def router(
    handler: Handler,
    durable: Durable,
    route_class: type[APIRoute],
    keep_secrets: KeepSecrets,
    watch: Watch,
) -> APIRouter:
    """Give the calls that change something.

    The route class hands an endpoint its Request and its checked body and passes the Response on;
    `request.state.user` must hold the caller's name. `watch` waits until reservations are granted.
    """
    calls = APIRouter(route_class=route_class)
    answering = Answering(handler, durable)
    OrderCalls(answering).join(calls)
    RobotCalls(answering, keep_secrets).join(calls)
    InstructionCalls(answering).join(calls)
    DeviceCalls(answering).join(calls)
    ResourceCalls(answering, watch).join(calls)
    return calls
