"""The services and the action of `simulation_interfaces`, as far as their types are installed."""

from collections.abc import Awaitable, Callable
from importlib import import_module
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.type_support import NoTypeSupportImportedException, check_for_type_support

from vibro_ros.ros.node.node import SteadyNode
from vibro_ros.ros.robot.simulation_action import offer_steps
from vibro_ros.ros.robot.simulation_control import SimulationControl
from vibro_ros.ros.robot.simulation_rules import FEATURES, Code, RefusalError

PACKAGE = "simulation_interfaces"
NAMES = {
    "GetSimulatorFeatures": "~/get_simulator_features",
    "ResetSimulation": "~/reset_simulation",
    "GetSimulationState": "~/get_simulation_state",
    "SetSimulationState": "~/set_simulation_state",
    "StepSimulation": "~/step_simulation",
    "SimulateSteps": "~/simulate_steps",
}
"""What is offered, by type."""
ABOUT = ("vibro_ros: a step is one publish period. A reset puts the state back and lets the clock go on; there is "
         "nothing to spawn.")

Answer = Callable[[Any, Any], Awaitable[Any]]


def offer_simulation(node: SteadyNode, control: SimulationControl) -> None:
    """Offer whatever has its type installed; the log says in one line what is left out."""
    types = installed_types()
    if missing := [name for name in NAMES if name not in types]:
        what = f"{PACKAGE} lacks {', '.join(missing)}" if types else f"{PACKAGE} is not installed"
        node.get_logger().info(f"{what}: without {', '.join(NAMES[name] for name in missing)}")
    group = ReentrantCallbackGroup()  # who waits for steps keeps nobody from being served
    answers = _answers(control, sorted({feature for name in types for feature in FEATURES[name]}))
    for name, kind in types.items():
        if name == "SimulateSteps":
            offer_steps(node, kind, NAMES[name], control)
        else:
            node.create_service(kind, NAMES[name], answers[name], callback_group=group)


def installed_types() -> dict[str, Any]:
    """The types of `NAMES` that are installed and can be used, by their names."""
    found = {}
    for name in NAMES:
        module = "action" if name == "SimulateSteps" else "srv"
        try:
            kind = getattr(import_module(f"{PACKAGE}.{module}"), name)
            check_for_type_support(kind)
        except (ImportError, AttributeError, NoTypeSupportImportedException):
            continue
        found[name] = kind
    return found


def _answers(control: SimulationControl, features: list[int]) -> dict[str, Answer]:
    """The callback of each service."""
    async def tell_features(request: Any, response: Any) -> Any:
        response.features.features, response.features.custom_info = features, ABOUT
        return response

    async def tell_state(request: Any, response: Any) -> Any:
        response.state.state, response.result.result = control.state, Code.OK
        return response

    return {
        "GetSimulatorFeatures": tell_features,
        "GetSimulationState": tell_state,
        "ResetSimulation": _answering(lambda request: control.reset(request.scope)),
        "SetSimulationState": _answering(lambda request: control.change_state(request.state.state)),
        "StepSimulation": _answering(lambda request: control.finish_steps(control.begin_steps(request.steps))),
    }


def _answering(perform: Callable[[Any], Awaitable[None]]) -> Answer:
    """The callback of a service whose answer is a result: a code, and words where something is wrong."""
    async def answer(request: Any, response: Any) -> Any:
        try:
            await perform(request)
            response.result.result = Code.OK
        except RefusalError as refusal:
            response.result.result, response.result.error_message = refusal.code, str(refusal)
        return response

    return answer
