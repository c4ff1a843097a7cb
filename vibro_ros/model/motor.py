"""The motor with a winding, a rotor and a bearing: `effects.motor: dc`.

At the crank, with K = n k_t (gear ratio times torque constant) and J = n² J_rotor + J_crank,

    J θ'' = K i - b θ' - T_c sign(θ') + T        L i' = V - R i - K θ'

where T = sum of D_j ds_j/dθ is the torque of the drives, less that which moves the masses of the linkage. θ is a
coordinate, and so is the charge Q, whose rate is the current i. The channel h is the voltage or current at which the
controller holds the motor until its next sample.

The *bearing* turns forwards or backwards, or sticks while abs(K i + T) <= T_s. The *current loop* of a drive with its
own current control, V = K θ' + R i + (L / τ) (h - i), works within the supply's voltage or at one of its limits.
Without inductance the current follows at once: i = (V - K θ') / R, or i = h.
"""

from vibro_ros.model.forms import Form, Forms, Guard, Target, without_jump
from vibro_ros.model.scene import Scene

#: Friction of the bearing, as a multiple of T_c.
BEARING = {"stuck": 0.0, "turns_forward": 1.0, "turns_backward": -1.0, "turns": 0.0}
#: Voltage of a current loop that is not within its limits, as a multiple of the supply's.
LIMITS = {"within_limits": 0.0, "at_upper_limit": 1.0, "at_lower_limit": -1.0}


class Motor:
    """The forms of one scene's dc motor."""

    def __init__(self, scene: Scene, forms: Forms):
        self._scene, self._forms = scene, forms
        self.constant, self.inertia = scene.motor_constant, scene.motor_inertia  # K [N m / A = V s], J [kg m²]
        self.friction, self.static_friction = scene["motor.friction"], scene["motor.static_friction"]  # T_c, T_s [N m]
        self.supply_voltage = scene["motor.supply_voltage"]
        self.resistance, self.inductance = scene["motor.winding_resistance"], scene["motor.winding_inductance"]
        loop = [CurrentLoop(self, forms)] if self.has_current_loop else []
        self.effects: tuple[Bearing | CurrentLoop, ...] = (Bearing(self, forms), *loop)

    @property
    def has_current_loop(self) -> bool:
        """Whether the drive holds a current, not a voltage."""
        return self._scene["motor.control"] == "speed_by_current"

    @property
    def current(self) -> Form:
        """Current i [A], the rate of the charge Q."""
        return self._forms.velocity(self._forms.charge)

    @property
    def speed(self) -> Form:
        """Speed of the crank, θ' [rad/s]."""
        return self._forms.velocity(self._forms.phase)

    @property
    def held(self) -> Form:
        """Held voltage [V] or current [A], h."""
        return self._forms.units[self._forms.channels.held]

    def wanted_voltage(self) -> Form:
        """Voltage that the current loop would apply without limits [V]."""
        if self.inductance == 0.0:
            return self.constant * self.speed + self.resistance * self.held
        gain = self.inductance / self._scene["motor.current_time_constant"]
        return self.constant * self.speed + self.resistance * self.current + gain * (self.held - self.current)

    def voltage(self, loop: str) -> Form:
        """Voltage V [V] in the state `loop` of the current loop; `loop` is empty if the motor has no current loop."""
        if not loop:
            return self.held
        limit = LIMITS[loop] * self.supply_voltage
        return limit * self._forms.one if limit else self.wanted_voltage()

    def drawn_current(self, loop: str) -> Form:
        """Current i [A] of a winding without inductance, in the state `loop` of the current loop."""
        if loop == "within_limits":
            return self.held
        return (self.voltage(loop) - self.constant * self.speed) / self.resistance

    def current_rate(self, loop: str) -> Form:
        """Rate of the current, i' [A/s], of a winding with inductance, in the state `loop` of the current loop."""
        if loop == "within_limits":
            return (self.held - self.current) / self._scene["motor.current_time_constant"]
        return (self.voltage(loop) - self.resistance * self.current - self.constant * self.speed) / self.inductance

    def driving_torque(self) -> Form:
        """Torque K i + T [N m], by which the motor and the drives turn the crank."""
        return self.constant * self.current + self._forms.units[self._forms.channels.torque]

    def bearing_torque(self, bearing: str) -> Form:
        """Friction torque b θ' + T_c sign(θ') [N m] of a bearing that turns."""
        return self._scene["motor.damping"] * self.speed + BEARING[bearing] * self.friction * self._forms.one

    def acceleration(self, bearing: str) -> Form:
        """Acceleration of the crank, θ'' [rad/s²], in the state `bearing`."""
        if bearing == "stuck":
            return self._forms.zero
        return (self.driving_torque() - self.bearing_torque(bearing)) / self.inertia


class Bearing:
    """A bearing with friction, or without: the crank turns, or sticks."""

    def __init__(self, motor: Motor, forms: Forms):
        self._motor, self._forms = motor, forms
        self.states = ("stuck", "turns_forward", "turns_backward") if motor.static_friction > 0.0 else ("turns",)

    def guards(self, state: str) -> list[Guard]:
        """Guards of `state`."""
        if state == "turns":
            return []
        if state == "stuck":
            torque, limit = self._motor.driving_torque(), self._motor.static_friction * self._forms.one
            constant, most = f"{self._motor.constant:.6g}", f"{self._motor.static_friction:g}"
            return [Guard(limit - torque, without_jump("turns_forward"), f"{constant} i + T <= {most}"),
                    Guard(limit + torque, without_jump("turns_backward"), f"-{constant} i - T <= {most}")]
        sign, other = (1.0, "turns_backward") if state == "turns_forward" else (-1.0, "turns_forward")
        stopped = ((self._forms.channels.velocity(self._forms.phase), self._forms.zero),)
        text = "θ' >= 0" if sign > 0.0 else "θ' <= 0"
        return [Guard(sign * self._motor.speed, (Target("stuck", stopped), Target(other, stopped)), text)]


class CurrentLoop:
    """A drive with current control, within the supply's voltage or at its limits."""

    states = tuple(LIMITS)

    def __init__(self, motor: Motor, forms: Forms):
        self._motor = motor
        self._limit = motor.supply_voltage * forms.one

    def guards(self, state: str) -> list[Guard]:
        """Guards of `state`."""
        wanted, limit, most = self._motor.wanted_voltage(), self._limit, f"{self._motor.supply_voltage:g}"
        if state == "within_limits":
            return [Guard(limit - wanted, without_jump("at_upper_limit"), f"{{voltage}} <= {most}"),
                    Guard(limit + wanted, without_jump("at_lower_limit"), f"{{voltage}} >= -{most}")]
        sign, text = (1.0, f"{{voltage}} >= {most}") if state == "at_upper_limit" else (
            -1.0, f"{{voltage}} <= -{most}")
        return [Guard(sign * wanted - limit, without_jump("within_limits"), text)]
