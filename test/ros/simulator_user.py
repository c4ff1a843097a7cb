"""A program that drives a robot by simulation_interfaces."""

from enum import IntEnum

from asking import wait_until_known
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile

LATE_SAMPLES = 200  # most samples, of a second, that arrive after the robot has paused
MOST_STEPS = 100_000
PATHS = {"GetSimulatorFeatures": "get_simulator_features", "ResetSimulation": "reset_simulation",
         "GetSimulationState": "get_simulation_state", "SetSimulationState": "set_simulation_state",
         "StepSimulation": "step_simulation", "GetEntityState": "get_entity_state",
         "SetEntityState": "set_entity_state"}


class Code(IntEnum):
    """Result codes of simulation_interfaces 2.1.0."""

    FEATURE_UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, OPERATION_FAILED = range(5)
    ALREADY_IN_TARGET_STATE, STATE_TRANSITION_ERROR, INCORRECT_TRANSITION = range(101, 104)


class State(IntEnum):
    """States of simulation_interfaces 2.1.0."""

    STOPPED, PLAYING, PAUSED, QUITTING, NO_WORLD, LOADING_WORLD = range(6)


class SimulationClient:
    """A client that knows the robot only as a simulator of simulation_interfaces."""

    def __init__(self, bench, types):
        self.bench, self.types, self.feedback = bench, types, []
        self.clients = {name: bench.node.create_client(getattr(types.srv, name), f"vibro_robot/{path}")
                        for name, path in PATHS.items()}
        self.action = ActionClient(bench.node, types.action.SimulateSteps, "vibro_robot/simulate_steps")
        # rclpy's client receives no feedback after the goal has ended, and one message a turn before.
        bench.node.create_subscription(types.action.SimulateSteps.Impl.FeedbackMessage,
                                       "vibro_robot/simulate_steps/_action/feedback", self._take_feedback,
                                       QoSProfile(depth=1000))

    def wait(self) -> None:
        self.bench.spin_until(lambda: self.action.server_is_ready() and all(
            client.service_is_ready() for client in self.clients.values()), "services")
        wait_until_known(self.bench)

    def begin(self, name: str, **fields):
        """Send a request and return the future of its answer."""
        request = getattr(self.types.srv, name).Request()
        for field, value in fields.items():
            setattr(request, field, value)
        return self.clients[name].call_async(request)

    def answer(self, future):
        self.bench.spin_until(future.done, "answer")
        return future.result()

    def call(self, name: str, **fields) -> tuple[int, str]:
        """Return code and message of the answer."""
        result = self.answer(self.begin(name, **fields)).result
        return result.result, result.error_message

    def become(self, state: int) -> int:
        """Request another state and return the result code."""
        return self.call("SetSimulationState", state=self.types.msg.SimulationState(state=state))[0]

    @property
    def state(self) -> int:
        answer = self.answer(self.begin("GetSimulationState"))
        assert answer.result.result == Code.OK
        return answer.state.state

    def begin_many_steps(self, listener):
        """Ask a paused robot for many steps; return the future of the answer once it is taking them."""
        listener.spin_for_samples(0)
        samples_before = len(listener.stamps)
        future = self.begin("StepSimulation", steps=MOST_STEPS)
        self.bench.spin_until(lambda: len(listener.stamps) > samples_before + LATE_SAMPLES, "steps")
        return future

    def send(self, steps: int):
        """Send a goal, which is always accepted, and return its handle; the result says what is wrong with the goal."""
        future = self.action.send_goal_async(self.types.action.SimulateSteps.Goal(steps=steps))
        goal = self.answer(future)
        assert goal.accepted
        return goal

    def result(self, goal) -> tuple[int, int, str]:
        """Return status, code and message of a goal."""
        answer = self.answer(goal.get_result_async())
        return answer.status, answer.result.result.result, answer.result.result.error_message

    def _take_feedback(self, message) -> None:
        self.feedback.append((message.feedback.completed_steps, message.feedback.remaining_steps))
