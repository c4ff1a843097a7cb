"""The robot's own services: reset, pause, step, record, set state, push, inject fault.

Each acts at once, in the executor's thread, by a method of `RobotRun`. Only steps are awaited, while the executor
serves others.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import SetBool, Trigger

from vibro_ros.messages.operations import PUSH, STATE, Operation
from vibro_ros.model.faults import Incident
from vibro_ros.ros.node.node import GuardedNode, installed_type
from vibro_ros.ros.robot.run import RobotRun, Steps

OWN_PACKAGE = "vibro_ros_interfaces"
DISTURBANCES = {"SetState": "~/set_state", "Push": "~/push", "InjectFault": "~/inject_fault"}
"""Names of the services with types of the project's own package, by type."""


def offer_run_services(node: GuardedNode, run: RobotRun) -> None:
    """Offer `~/record`, `~/reset`, `~/pause` and `~/step`."""
    def record(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success, response.message = run.recording.switch(request.data)
        return response

    async def step(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = await finished(run, run.begin_steps(1))
        response.success = True
        return response

    node.create_service(SetBool, "~/record", record)
    node.create_service(Trigger, "~/step", step, callback_group=ReentrantCallbackGroup())
    _offer(node, Trigger, "~/reset", lambda _: run.reset())
    _offer(node, SetBool, "~/pause", lambda request: run.pause() if request.data else run.resume())


def offer_disturbances(node: GuardedNode, run: RobotRun) -> None:
    """Offer the services of `DISTURBANCES` whose types are installed; the log names the others in one line."""
    types = installed_types(OWN_PACKAGE, DISTURBANCES)
    if len(types) < len(DISTURBANCES):
        node.get_logger().info(f"{OWN_PACKAGE} is not installed, or old: without "
                               f"{', '.join(path for name, path in DISTURBANCES.items() if name not in types)}")
    act: dict[str, Callable[[Any], str]] = {
        "SetState": partial(_set_state, run),
        "Push": lambda request: run.disturb(Operation(PUSH, parameters={
            name: getattr(request, name) for name in ("duration", "force_x", "force_z")})),
        "InjectFault": lambda request: run.fail(Incident(**{
            name: getattr(request, name) for name in Incident._fields}))}
    for name, kind in types.items():
        _offer(node, kind, DISTURBANCES[name], act[name])


def _offer(node: GuardedNode, kind: type, name: str, act: Callable[[Any], str]) -> None:
    """Offer a service that is answered with the words that `act` returns."""
    def answer(request: Any, response: Any) -> Any:
        response.message = act(request)
        response.success = True
        return response

    node.create_service(kind, name, answer)


def _set_state(run: RobotRun, request: Any) -> str:
    names = list(request.names)
    if len(names) != len(request.values) or len(set(names)) != len(names):
        raise ValueError(f"names, values: {len(names)} names, {len(set(names))} of them different, and "
                         f"{len(request.values)} values; give one value for each name")
    given = dict(zip(names, map(float, request.values), strict=True))
    return run.reset(given) if request.reset else run.disturb(Operation(STATE, parameters=given))


async def finished(run: RobotRun, steps: Steps) -> str:
    """Wait for steps and return their answer in words (RuntimeError if the run ends); `run.waiting` counts the wait."""
    run.waiting += 1
    try:
        return await steps
    finally:
        run.waiting -= 1


def installed_types(package: str, names: Iterable[str]) -> dict[str, Any]:
    """Return the types of `names` that are installed and have type support, by name."""
    types = {name: installed_type(package, "action" if name == "SimulateSteps" else "srv", name) for name in names}
    return {name: kind for name, kind in types.items() if kind}
