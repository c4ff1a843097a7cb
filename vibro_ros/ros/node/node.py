"""A node that keeps running, whatever its peers send.

In rclpy a malformed request or message raises an exception out of a callback, such as an unknown type number in
`set_parameters` or a negative second on `/clock`. Here such a request is answered with a reason, because a caller
without an answer waits for ever, and such a message is refused.
"""

import copy
import time
from collections.abc import Callable, Iterable
from functools import partial
from importlib import import_module
from inspect import isawaitable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.type_support import NoTypeSupportImportedException, check_for_type_support
from rosgraph_msgs.msg import Clock

from vibro_ros.configuration.parameter_file import FIXED_OF_RCLPY
from vibro_ros.messages.topics import TOPICS
from vibro_ros.process.files import one_line
from vibro_ros.ros.node.parameters import change_of, set_refusal
from vibro_ros.ros.node.refusals import LONGEST_SENTENCE, Refusals

LAST_SECOND = 2**31 - 1 - 10**7
"""Latest ROS time [s] that is accepted from /clock: a stamp's seconds end at 2**31 - 1, some months later."""
MOST_NAMES = 1000  # most names in one request to a parameter service; the robot has fewer parameters
LONGEST_NAME = 1000  # longest name in such a request [characters]
UNPUBLISHED = 0.02
"""Time [s] between two polls of a topic without publishers, for one that came and left between two polls."""
OVERRIDES = "qos_overrides"
POLICIES = {"reliability": ("reliable", "best_effort"), "history": ("keep_last", "keep_all"), "depth": ()}
"""The policies that a user may override, and their values; a depth is a number."""
DEEPEST = 100_000  # largest depth [messages] that a user may give
SENTENCES = ("message", "reason", "error_message")  # fields of service responses that hold a sentence


class GuardedNode(Node):
    """A node that refuses malformed requests and messages; ROS arguments may change its name.

    `clock_heard` is whether a time, perhaps 0, was received on /clock. ValueError when one of rclpy's own parameters
    is given and is not a boolean.
    """

    def __init__(self, name: str):
        self.refusals = Refusals(self.get_logger)
        self.clock_heard = False
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        for parameter, meaning in FIXED_OF_RCLPY.items():
            _make_read_only(self, parameter, meaning)

    def declare_parameters(self, namespace: str, parameters: Any, ignore_override: bool = False) -> list[Parameter]:
        """As in `Node`; a value that is an empty list, which rclpy refuses without the parameter's name, is named."""
        for name, value, *_ in parameters:
            if value is None:
                raise ValueError(f"{name}: its list is empty, which has no type in ROS; give a value, or leave the "
                                 "parameter out")
        return super().declare_parameters(namespace, parameters, ignore_override)

    def create_service(self, srv_type: type, srv_name: str, callback: Callable, **options: Any) -> Service:
        """As in `Node`; if `callback`, a function or a coroutine, raises, the request is answered as refused.

        The words of a ValueError or RuntimeError are the answer's; its `code`, if it has one, is the result's.
        """
        callback = partial(self._answer, self.resolve_service_name(srv_name), callback)
        return super().create_service(srv_type, srv_name, callback, **options)

    def create_publisher(self, msg_type: type, topic: str, qos_profile: QoSProfile | int, **options: Any) -> Publisher:
        """As in `Node`, with the user's `qos_overrides`."""
        qos_profile, options = self._apply_overrides(topic, "publisher", qos_profile, options)
        return super().create_publisher(msg_type, topic, qos_profile, **options)

    def create_subscription(self, msg_type: type, topic: str, callback: Callable, qos_profile: QoSProfile | int,
                            **options: Any) -> Subscription:
        """As in `Node`, with the user's `qos_overrides`; an invalid time on `/clock` does not reach `callback`."""
        if msg_type is Clock:
            callback = partial(self._take_clock, self.resolve_topic_name(topic), callback)
        qos_profile, options = self._apply_overrides(topic, "subscription", qos_profile, options)
        return super().create_subscription(msg_type, topic, callback, qos_profile, **options)

    def _apply_overrides(self, topic: str, kind: str, profile: QoSProfile | int, options: dict[str, Any]
                    ) -> tuple[QoSProfile | int, dict[str, Any]]:
        """Return the profile and the options with which rclpy applies the user's overrides of a topic.

        Without overrides both are unchanged, and rclpy declares no parameters for them. Otherwise the profile is a
        copy, because rclpy changes the one that it is given.
        """
        name = f"{OVERRIDES}.{self.resolve_topic_name(topic)}.{kind}"
        policies = [policy for policy in QoSPolicyKind if self.has_parameter(f"{name}.{policy.name.lower()}")]
        if not policies:
            return profile, options
        return copy.copy(profile), {**options, "qos_overriding_options": QoSOverridingOptions(policies)}

    async def _answer(self, name: str, callback: Callable, request: Any, response: Any) -> Any:
        try:
            _check_names(request)
            if isinstance(request, SetParameters.Request | SetParametersAtomically.Request):
                callback = partial(self._set_parameters, name)
            answer = callback(request, response)
            response = await answer if isawaitable(answer) else answer
            if reason := _reason_of_failure(response):
                self.refusals.refuse(name, reason)
        except (ValueError, RuntimeError) as error:  # a refusal in words
            self.refusals.refuse(name, str(error))
            response = _fill_refusal(request, response, str(error), getattr(error, "code", None))
        except Exception as error:  # whatever it is, the caller waits for an answer
            self.refusals.catch(name, error)
            response = _fill_refusal(request, response, f"{type(error).__name__}; the node's log says more")
        return _bounded(response)

    def _set_parameters(self, name: str, request: Any, response: Any) -> Any:
        """Set all parameters of a request, or none; a read-only parameter may be given its present value."""
        reasons = [set_refusal(self, parameter) for parameter in request.parameters]
        first_reason = next(filter(None, reasons), "")
        changes = [] if first_reason else [
            change for parameter in request.parameters if (change := change_of(self, parameter))]
        if changes:
            result = self.set_parameters_atomically(changes)
            first_reason = "" if result.successful else result.reason
        if first_reason:
            self.refusals.refuse(name, first_reason)
        if isinstance(request, SetParametersAtomically.Request):
            response.result = _answer_to_set(first_reason)
        else:
            response.results = [
                _answer_to_set(first_reason and (reason or f"not set, because of another: {first_reason}"))
                for reason in reasons]
        return response

    def _take_clock(self, name: str, callback: Callable, message: Clock) -> None:
        seconds, nanoseconds = message.clock.sec, message.clock.nanosec
        if 0 <= seconds <= LAST_SECOND and nanoseconds < 1_000_000_000:
            callback(message)
            self.clock_heard = True
        else:
            self.refusals.refuse(name, f"{seconds} s and {nanoseconds} ns is no time; give 0 to {LAST_SECOND} s and "
                                       "below 1000000000 ns")


class PollingSubscription:
    """A subscription whose owner polls for messages, as bytes; an arriving message does not wake the executor.

    The depth of the quality of service limits the messages that wait. `topic` is the topic's full name, `profile` the
    quality of service with the user's `qos_overrides`. `take_message` of rclpy's handle is public but not documented;
    test_node.py fails with an explanation when it changes. Do not poll while the node is destroyed.

    A topic without publishers is asked for messages only every `UNPUBLISHED` seconds, and once when its last publisher
    has left, because asking for messages costs three times as much as asking for publishers.
    """

    def __init__(self, node: Node, kind: type, topic: str, profile: QoSProfile):
        self._subscription: Subscription = node.create_subscription(kind, topic, lambda message: None, profile,
                                                                    callback_group=_NeverRun(), raw=True)
        self.topic: str = self._subscription.topic_name
        self.profile: QoSProfile = self._subscription.qos_profile
        self._take, self._kind = self._subscription.handle.take_message, self._subscription.msg_type
        self._count_publishers, self._publishers, self._due = self._subscription.handle.get_publisher_count, 0, 0.0

    def take(self, most: int) -> list[tuple[bytes, int]]:
        """Take up to `most` messages in order of arrival, each with the wall time [ns] at which it arrived."""
        messages: list[tuple[bytes, int]] = []
        earlier, self._publishers = self._publishers, self._count_publishers()
        if not self._publishers and not earlier:
            if (now := time.monotonic()) < self._due:
                return messages
            self._due = now + UNPUBLISHED
        while len(messages) < most and (taken := self._take(self._kind, True)):
            messages.append((taken[0], taken[1]["received_timestamp"]))
        return messages


class _NeverRun(CallbackGroup):
    """A callback group that never runs, so that the executor does not wait for its subscription."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        pass


def installed_type(package: str, kind: str, name: str) -> Any:
    """Return a type of an interface package; None if it is not installed or has no type support.

    `kind` is the package's module, such as `srv` or `action`.
    """
    try:
        interface = getattr(import_module(f"{package}.{kind}"), name)
        check_for_type_support(interface)
    except (ImportError, AttributeError, NoTypeSupportImportedException):
        return None
    return interface


def message_class(type_name: str) -> type:
    """Return the class of a message type, ``nav_msgs/msg/Odometry`` (ValueError names the package to install)."""
    package, _, name = type_name.partition("/msg/")
    if not (kind := installed_type(package, "msg", name)):
        raise ValueError(f"{type_name}: no such message here; install the ROS package {package}")
    return kind


def qos_profile(topic: str) -> QoSProfile:
    """Return the quality of service of one of the robot's topics, a key of `TOPICS`."""
    depth, reliable, transient_local = TOPICS[topic].quality
    return QoSProfile(
        depth=depth, reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if transient_local else DurabilityPolicy.VOLATILE)


def check_qos_overrides(node: Node, publishers: Iterable[str], subscriptions: Iterable[str]) -> None:
    """Refuse each `qos_overrides` parameter that would have no effect or has a bad value; make the others read-only.

    `publishers` and `subscriptions` are the node's topics, before namespace and remapping. ValueError names the
    parameter, the limit and the remedy.
    """
    topics = {"publisher": [node.resolve_topic_name(name) for name in publishers],
              "subscription": [node.resolve_topic_name(name) for name in subscriptions]}
    for name, parameter in node.get_parameters_by_prefix(OVERRIDES).items():
        shown, value = f"{OVERRIDES}.{name}", parameter.value
        topic, kind, policy = ("", "", *name.rsplit(".", 2))[-3:]
        if kind not in topics or topic not in topics[kind]:
            known = ", ".join(sorted(topics.get(kind, [])))
            raise ValueError(f"{shown}: this node has no {kind} {topic}; give one of {known}" if known else
                             f"{shown}: not understood; write {OVERRIDES}./TOPIC.publisher.POLICY or "
                             f"{OVERRIDES}./TOPIC.subscription.POLICY")
        if policy not in POLICIES:
            raise ValueError(f"{shown}: {policy} cannot be overridden here; give one of {', '.join(POLICIES)}")
        if policy == "depth":
            if type(value) is not int or not 1 <= value <= DEEPEST:
                raise ValueError(f"{shown}: {value!r} is no depth; give a whole number from 1 to {DEEPEST}")
        elif value not in POLICIES[policy]:
            raise ValueError(f"{shown}: {value!r} is unknown; choose one of {', '.join(POLICIES[policy])}")
        node.set_descriptor(shown, ParameterDescriptor(
            description=f"{policy} of the {kind} {topic}", read_only=True, type=parameter.type_.value))


def _make_read_only(node: Node, name: str, meaning: str) -> None:
    """Make a parameter that rclpy has declared a read-only boolean (ValueError if its value is no boolean)."""
    if node.describe_parameter(name).read_only:
        return
    try:
        node.set_descriptor(name, ParameterDescriptor(description=meaning, type=ParameterType.PARAMETER_BOOL,
                                                      read_only=True))
    except InvalidParameterValueException:
        value = node.get_parameter(name).value
        raise ValueError(f"{name}: {value!r} is not true or false; give true or false") from None


def _check_names(request: Any) -> None:
    """Refuse a request of any service with too many or too long names (ValueError)."""
    parameters = [parameter.name for parameter in getattr(request, "parameters", ())]
    names = [*parameters, *getattr(request, "names", ()), *getattr(request, "prefixes", ())]
    if len(names) > MOST_NAMES:
        raise ValueError(f"{len(names)} names in one request; give at most {MOST_NAMES}")
    if (longest := max(map(len, names), default=0)) > LONGEST_NAME:
        raise ValueError(f"a name of {longest} characters; give at most {LONGEST_NAME}")


def _answer_to_set(reason: str) -> SetParametersResult:
    return SetParametersResult(successful=not reason, reason=reason)


def _reason_of_failure(response: Any) -> str:
    """Return the reason in a response that reports a failure; empty if it reports success, or neither."""
    if hasattr(response, "success"):  # of std_srvs and of the project's own
        return "" if response.success else response.message
    return getattr(getattr(response, "result", None), "error_message", "")  # of simulation_interfaces


def _bounded(response: Any) -> Any:
    """Make each sentence of a response one printable line, because it may quote what a peer sent."""
    results = getattr(response, "results", ()) if isinstance(response, SetParameters.Response) else ()
    for part in (response, getattr(response, "result", None), *results):
        for field in SENTENCES:
            if isinstance(text := getattr(part, field, None), str):
                setattr(part, field, one_line(text, LONGEST_SENTENCE))
    return response


def _fill_refusal(request: Any, response: Any, reason: str, code: int | None = None) -> Any:
    """Make `response` the refusal of `request`, with the reason where its type has a field for it."""
    if isinstance(request, SetParameters.Request):
        response.results = [_answer_to_set(reason)] * len(request.parameters)
    elif isinstance(request, SetParametersAtomically.Request):
        response.result = _answer_to_set(reason)
    elif hasattr(response, "success"):  # of std_srvs and of the project's own
        response.success, response.message = False, reason
    elif hasattr(getattr(response, "result", None), "error_message"):  # of simulation_interfaces
        response.result.result = response.result.RESULT_OPERATION_FAILED if code is None else code
        response.result.error_message = reason
    return response
