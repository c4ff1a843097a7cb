"""The stateful device: commands in, samples and events out."""

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vibro_ros.model.faults import DEVICE, DURATION, FAULTS, FORCE, Incident, check_lasting, checked_incident, part_of
from vibro_ros.model.parameters import BY_NAME, parameter_named
from vibro_ros.model.scene import Scene, check_scene
from vibro_ros.simulation import checkpoint as checkpoints
from vibro_ros.simulation.crank_angle import advance_to_angle
from vibro_ros.simulation.disturbances import PATCH, PUSH, SAG, STALL, patched
from vibro_ros.simulation.motion import Motion
from vibro_ros.simulation.samples import LATEST, Samples, checked_times, one_sample


class ToleranceWarning(UserWarning):
    """Warning that rounding does not permit the default `solver.tolerance`; an explicit one is refused."""


class Simulator:
    """The virtual device, stepped in simulated time.

    Its memory does not grow with time, except for events, which are kept until `take_events` returns them. A method
    that advances the device or changes its motion raises a SimulationError if the run cannot go on.

    Parameters
    ----------
    scene : Scene
        The scene to simulate.
    acceleration_bandwidth : float
        Frequency [Hz] at which `filtered_acceleration` loses 3 dB; 0, the default, for no filter. Needs
        `solver.method` exact.

    Examples
    --------
    >>> device = vibro_ros.Simulator(vibro_ros.load_scene("device"))
    >>> device.command(motor_speed=100.0)
    >>> device.advance_to(0.5)
    >>> f"{device.state.body_position:.6f} m after {device.time} s"
    '-0.005570 m after 0.5 s'
    """

    def __init__(self, scene: Scene, acceleration_bandwidth: float = 0.0):
        check_scene(scene)
        if acceleration_bandwidth and scene["solver.method"] != "exact":
            raise ValueError(f"solver.method: {scene['solver.method']} has no exact motion to filter; choose exact")
        if fault := scene.broken_promise:
            warnings.warn(fault, ToleranceWarning, stacklevel=2)
        self._bandwidth = acceleration_bandwidth
        self._motion = Motion(scene, acceleration_bandwidth)

    @property
    def scene(self) -> Scene:
        """The scene that is simulated, with the present values of its parameters.

        Examples
        --------
        >>> vibro_ros.Simulator(vibro_ros.load_scene("paper")).scene["mass.body"]
        1.0
        """
        return self._motion.scene

    @property
    def time(self) -> float:
        """Simulated time [s], from 0.

        Examples
        --------
        >>> vibro_ros.Simulator(vibro_ros.load_scene("paper")).time
        0.0
        """
        return self._motion.time

    @property
    def state(self) -> Samples:
        """The present state: every field of `Samples` as one number.

        Examples
        --------
        >>> vibro_ros.Simulator(vibro_ros.load_scene("paper")).state.motor_speed
        100.0
        """
        return one_sample(self._motion.now())

    @property
    def values(self) -> np.ndarray:
        """The present values of all `FIELDS` of `state`, shape (fields,); the next call overwrites them.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("paper"))
        >>> list(device.values) == list(vars(device.state).values())
        True
        """
        return self._motion.now()

    def filtered_acceleration(self) -> tuple[float, float]:
        """Return the body's present acceleration [m/s²] along x and upwards after a second-order Butterworth low-pass.

        The result is exact: landings, blows and a speed given to `set_state` enter as steps of the speed. The last
        digit depends on the instants of earlier calls, not on those to which the device was advanced.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"), acceleration_bandwidth=100.0)
        >>> device.advance_to(0.2)
        >>> f"{device.filtered_acceleration()[0]:.6f} m/s²"
        '28.282938 m/s²'
        """
        return self._motion.filtered_acceleration()

    @property
    def commanded_motor_speed(self) -> float:
        """Commanded speed of the motor [rad/s], by a command or the scene; for a dc motor with `motor.control` voltage,
        the commanded voltage [V].

        Examples
        --------
        >>> vibro_ros.Simulator(vibro_ros.load_scene("paper")).commanded_motor_speed
        100.0
        """
        return self._motion.actuators.motor_target

    @property
    def controller_integral(self) -> float:
        """Integral of a dc motor's controller [V, or A with `speed_by_current`]; 0 without a controller.

        It jumps at every sample of the controller. At the very instant of a sample, a multiple of
        1 / `motor.control_rate`, rounding decides whether the integral is that before or after the sample.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("machine"))
        >>> device.command(motor_speed=100.0)
        >>> device.advance_to(0.9995)
        >>> f"{device.controller_integral:.3f} A"
        '1.529 A'
        """
        return self._motion.actuators.controller_integral

    @property
    def supply_voltage(self) -> float:
        """Present supply voltage of a dc motor [V]: `motor.supply_voltage`, or less during a sag.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("machine"))
        >>> device.fail("supply_sag", duration=0.5, value=9.0)
        >>> device.supply_voltage
        9.0
        """
        return self._motion.disturbances.supply_voltage_of(self.scene)

    def command(self, motor_speed: float | None = None, upper_gap: float | None = None,
                inclined_gap: float | None = None, motor_voltage: float | None = None) -> None:
        """Command a motor speed [rad/s] and gaps [m] from now on.

        The speed follows as `effects.motor` says; the plates move at `gap_actuator.speed`. A dc motor whose
        `motor.control` is voltage takes a voltage [V] in place of a speed.

        Raises
        ------
        ValueError
            For a value that is not finite or beyond its limit; nothing is changed then.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> device.command(motor_speed=120.0, upper_gap=0.0005)
        >>> device.state.motor_speed
        120.0
        >>> device.command(upper_gap=0.07)
        Traceback (most recent call last):
        ValueError: upper.gap: 0.07 is out of range; give a number from -0.06 to 0.06 m (the limit is the rod's length)
        """
        given = {"motor_speed": motor_speed, "upper_gap": upper_gap, "inclined_gap": inclined_gap,
                 "motor_voltage": motor_voltage}
        commands = {name: self.scene.checked_command(name, value) for name, value in given.items() if value is not None}
        motor = commands.get(self.scene.motor_command)
        if motor is not None:
            self._check_jump(motor)
        gaps = {side: commands[f"{side}_gap"] for side in ("upper", "inclined") if f"{side}_gap" in commands}
        self._motion.command(motor, gaps)

    def _check_jump(self, speed: float) -> None:
        """Refuse a new motor speed [rad/s] of an ideal motor with linkage masses, whose speeds would jump."""
        if speed != self.commanded_motor_speed and self.scene.linkage and self.scene["effects.motor"] == "ideal":
            raise ValueError(f"motor_speed: {speed:g} rad/s would be reached at once by effects.motor 'ideal', and "
                             f"mass.{self.scene.linkage[0]} would strike the body; choose ramp or lag")

    def set_parameters(self, changes: Mapping[str, object]) -> None:
        """Change parameters of the scene from now on: those that `SCENE_PARAMETERS` marks as `while_running`.

        A motor speed or a plate that is still changing goes on to its target under the new parameters.
        With `ground.friction` the robot goes on over another floor.

        Parameters
        ----------
        changes : mapping of str to value
            Names and values; all of them take effect, or none.

        Raises
        ------
        ValueError
            For a parameter that may not change while running, a value beyond its limit, or a `motor.max_speed` below
            the commanded speed; nothing is changed then.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> device.advance_to(0.2)
        >>> device.set_parameters({"ground.friction": 0.4})
        >>> device.scene["ground.friction"], device.time
        (0.4, 0.2)
        >>> device.set_parameters({"mass.body": 2.0})
        Traceback (most recent call last):
        ValueError: mass.body: makes another machine and cannot change while the device runs; start one with it
        """
        for name in changes:
            if not parameter_named(name, BY_NAME).while_running:
                raise ValueError(f"{name}: makes another machine and cannot change while the device runs; start one "
                                 "with it")
        scene = self.scene.with_parameters(changes)
        target, fastest = self.commanded_motor_speed, scene["motor.max_speed"]
        if scene.motor_command == "motor_speed" and abs(target) > fastest:
            raise ValueError(f"motor.max_speed: {fastest:g} is below the commanded motor speed, {target:g} rad/s; "
                             "command a slower one first")
        self._motion.change(scene)

    def set_state(self, /, **given: float) -> None:
        """Put the device into a given state at its present time.

        The state is given by fields of `state`: `body_position`, `body_velocity`, `body_height`,
        `body_vertical_velocity`, `upper_position`, `upper_velocity`, `inclined_position`, `inclined_velocity`,
        `crank_angle`, `motor_speed`, `upper_plate_position` and `inclined_plate_position`, in the units and signs of
        `Samples`; for a dc motor also by `motor_current`, if its winding has an inductance, and `controller_integral`,
        if it has a controller. Other fields do not change, and neither do commands: plates, and a motor that is not
        `ideal`, go on from the given state to their targets. An `ideal` motor keeps the given speed. A contact in
        progress is not recorded as an event. A sample that a controller has taken at this very instant is taken again
        if its integral is given.

        Raises
        ------
        ValueError
            For no number, an unknown name, a number that is not finite or beyond its limit, a part that the scene does
            not have, or a mass beyond a rigid plate or deeper in a compliant one than a blow of this machine could
            drive it (`Scene.deepest_penetration`). Nothing is changed then.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> device.advance_to(0.2)
        >>> device.set_state(upper_position=0.05, body_velocity=0.0)
        >>> device.time, device.state.upper_position
        (0.2, 0.05)
        >>> device.set_state(crank_angle=1e10)
        Traceback (most recent call last):
        ValueError: crank_angle: 1e+10 is out of range; give a number from -1e+09 to 1e+09 rad
        """
        self._motion.set_state(given)

    def push(self, duration: float, force_x: float = 0.0, force_z: float = 0.0) -> None:
        """Push the body with a constant external force from now on, which replaces a push that is still active.

        The motion stays exact: the body may start, lift off or land. A short push acts as a blow: an impulse of
        0.1 N s is ``push(1e-4, force_x=1000.0)``. To change the body's speed at once, use `set_state`.

        Parameters
        ----------
        duration : float
            Duration [s]; 0, without a force, ends the present push.
        force_x : float
            Force [N] along the ground, forwards positive; only in a scene whose body moves.
        force_z : float
            Force [N] upwards; only in a scene whose body may leave the ground (`effects.normal_force` hop).

        Raises
        ------
        ValueError
            For a number beyond its limit, a force in a direction in which the body cannot move, a duration without a
            force or a force without a duration, and if there is no push to end; nothing is changed then.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped").with_parameters({"motor.speed": 0.0}))
        >>> device.push(0.1, force_x=5.0)
        >>> device.advance_to(1.0)
        >>> f"{device.state.body_position:.6f} m"
        '0.024505 m'
        """
        duration = DURATION.checked(duration)
        force_x = replace(FORCE, name="force_x").checked(force_x)
        force_z = replace(FORCE, name="force_z").checked(force_z)
        if force_x and not self.scene.body_moves:
            raise ValueError(f"force_x: {force_x:g} N, but the body of this scene stays where it is; leave it out")
        if force_z and not self.scene.body_hops:
            raise ValueError(f"force_z: {force_z:g} N, but the body of this scene stays on the ground; leave it out, "
                             "or choose effects.normal_force hop")
        if bool(duration) != bool(force_x or force_z):
            raise ValueError(f"duration: {duration:g} s with a force of {force_x:g} N along x and {force_z:g} N "
                             "upwards pushes nothing; give a duration and a force, or neither to end the present push")
        check_lasting(PUSH, "", duration, self.disturbances)
        self._motion.disturb(PUSH, "", self.time + duration, (force_x, force_z))

    def fail(self, fault: str, duration: float, of: str = "", value: float = 0.0, from_x: float = 0.0,
             to_x: float = 0.0) -> None:
        """Start a fault of the device from now on, one of `FAULTS`.

        Parameters
        ----------
        fault : str
            `motor_stall`: the motor stops as it does for a command of 0, and does not follow commands meanwhile; the
            bearing of a dc motor is seized. `plate_stuck`: a plate stands where it is, and does not follow commands
            meanwhile. Afterwards both follow the last command. `supply_sag`: a dc motor's supply has `value` volts.
            `friction_patch`: the ground has the friction coefficient `value`, as ice has, where the body's position
            is from `from_x` to `to_x`; by `solver.method` exact.
        duration : float
            Duration [s]; 0 ends the fault, which must last.
        of : str
            The plate that sticks, `upper` or `inclined`.
        value : float
            The supply's voltage [V], above 0 and at most `motor.supply_voltage`, or the patch's friction coefficient,
            which is the same at rest and in both directions; other faults need no value.
        from_x, to_x : float
            The ends of the patch [m].

        Raises
        ------
        ValueError
            For a fault that the scene cannot have, a number beyond its limit, or if there is no such fault to end;
            nothing is changed then.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> device.fail("motor_stall", duration=0.5)
        >>> device.state.motor_speed, device.disturbances
        (0.0, {'motor_stall': 0.5})
        >>> device.advance_to(0.6)
        >>> device.state.motor_speed, device.disturbances
        (100.0, {})
        """
        incident = checked_incident(fault, duration, of, value, from_x, to_x)
        self._check_incident(incident)
        name, duration, side, *numbers = incident
        self._motion.disturb(name, side, self.time + duration, numbers if name == PATCH else numbers[:1])

    def _check_incident(self, incident: Incident) -> None:
        """Refuse a fault that the scene cannot have, and the end of a fault that is not active (ValueError)."""
        name, duration, side, value, *_ = incident
        if FAULTS[name].affects != DEVICE:
            raise ValueError(f"fault: {name} befalls {FAULTS[name].affects}, which this device does not have")
        if side and side not in self.scene.plates:
            raise ValueError(f"of: this scene has no {side} plate; give {' or '.join(self.scene.plates) or 'none'}")
        if name == STALL and duration:
            self._check_jump(0.0)
        if name == PATCH and duration:
            patched(self.scene, value)
        if name == SAG:
            if not self.scene.has_rotor:
                raise ValueError(f"fault: {name} befalls a dc motor, and this one is {self.scene['effects.motor']}; "
                                 "leave it out, or choose dc for effects.motor")
            if value > (supply := self.scene["motor.supply_voltage"]):
                raise ValueError(f"value: {value:g} V is above motor.supply_voltage, and no sag; give at most "
                                 f"{supply:g} V")
        check_lasting(name, side, duration, self.disturbances)

    @property
    def disturbances(self) -> dict[str, float]:
        """Active disturbances, a push or faults of the device, each with the instant [s] at which it ends.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> device.fail("plate_stuck", duration=0.5, of="upper")
        >>> device.disturbances
        {'plate_stuck of upper': 0.5}
        """
        return {part_of(name, of): until for (name, of), until in self._motion.disturbances.lasting().items()}

    def reset(self, /, **given: float) -> None:
        """Put the device back to its start: time 0, the state and the commands of the scene's parameters, no events.

        A push and faults end. From then on the device moves, bit for bit, as a new device of the present `scene`. If a
        state is `given`, the device is in that state at time 0, as after `set_state`.

        Raises
        ------
        ValueError
            For a given state that `set_state` refuses; nothing is changed then.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> device.advance_to(0.2)
        >>> device.reset()
        >>> device.time, device.state.body_position
        (0.0, 0.0)
        >>> device.reset(body_position=1.0)
        >>> device.time, device.state.body_position
        (0.0, 1.0)
        """
        motion = Motion(self.scene, self._bandwidth)
        if given:
            motion.set_state(given)
        self._motion = motion

    def checkpoint(self) -> np.ndarray:
        """Return all that the device's future depends on besides later commands, for `restore`; shape (n,).

        The parameters that may change while the device runs are included, in the order of `SCENE_PARAMETERS`, after the
        time. The scene's other parameters, events that were not taken, and the counts of `statistics` are not.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> device.advance_to(0.2)
        >>> checkpoint, other = device.checkpoint(), vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> other.restore(checkpoint)
        >>> other.state == device.state
        True
        """
        return checkpoints.checkpoint_of(self._motion)

    def restore(self, checkpoint: np.ndarray) -> None:
        """Go on from a `checkpoint` of a device of the same scene, bit for bit as that device; time may go back.

        Parameters that may change while the device runs get the values that they had at the checkpoint, also in
        `scene`; the two scenes may differ in them.

        Raises
        ------
        ValueError
            For a checkpoint whose size does not fit the scene, or whose numbers no device can have, as in a forged bag.
            Nothing is changed then.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> start = device.checkpoint()
        >>> device.advance_to(0.2)
        >>> device.restore(start)
        >>> device.time
        0.0
        """
        checkpoints.restore(self._motion, checkpoint)

    def advance_to(self, time: float) -> None:
        """Advance to the absolute instant `time` [s]; the motion does not depend on how the time is divided into calls.

        Raises
        ------
        ValueError
            If `time` is not finite, lies before `self.time`, or beyond `LATEST`.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("paper"))
        >>> device.advance_to(0.25)
        >>> device.time, round(device.state.crank_angle, 6)
        (0.25, 25.0)
        """
        time = float(time)
        if not (math.isfinite(time) and time >= self.time):
            raise ValueError(f"cannot advance to {time:g} s: the device is at {self.time:g} s and time runs forwards")
        if time > LATEST:
            raise ValueError(f"cannot advance to {time:g} s: give at most {LATEST:g} s, beyond which clocks are coarse")
        self._motion.advance_to(time)

    def advance_to_angle(self, turn: int, angle: float, latest: float = LATEST) -> bool:
        """Advance exactly to the instant at which the crank of a dc motor first reaches an angle.

        Parameters
        ----------
        turn : int
            Whole turns of the crank before the angle.
        angle : float
            Angle within the next turn [rad], from 0 to 2 pi.
        latest : float
            Instant [s] at which the device stops if the crank does not reach the angle before, because the crank rests
            or turns backwards.

        Returns
        -------
        bool
            Whether the crank has reached the angle. If it was beyond the angle before, the device stays where it is.

        Raises
        ------
        ValueError
            For a motor whose angle is given in time, or a `solver.method` of fixed step, and for an instant out of
            range.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("machine").with_parameters({"motor.speed": 100.0}))
        >>> device.advance_to_angle(turn=3, angle=1.0)
        True
        >>> f"{device.time:.5f} s, {device.state.crank_angle - 1.0:.12f} rad"
        '0.22856 s, 18.849555921539 rad'
        """
        if not self.scene.has_rotor or self.scene["solver.method"] != "exact":
            raise ValueError(f"effects.motor, solver.method: {self.scene['effects.motor']}, "
                             f"{self.scene['solver.method']} have no angle to advance to; choose dc and exact")
        if not self.time <= latest <= LATEST:
            raise ValueError(f"latest: {latest:g} s is out of range; give a time from {self.time:g} to {LATEST:g} s")
        return advance_to_angle(self._motion, turn, angle, latest)

    def sample(self, times: np.ndarray) -> Samples:
        """Advance to each of `times` [s] in turn, and return the samples there, every field of shape (n,).

        Raises
        ------
        ValueError
            If `times` is not one-dimensional, ascending and from `self.time` to `LATEST`.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("paper"))
        >>> device.sample([0.0, 0.01, 0.02]).crank_angle
        array([0., 1., 2.])
        """
        return Samples(**self._motion.sampled(checked_times(times, self.time)))

    def sample_filtered(self, times: np.ndarray) -> tuple[Samples, np.ndarray]:
        """Advance to each of `times` [s] in turn; return samples and `filtered_acceleration` there, shape (n, 2).

        The bits are those of single calls, which cost more.

        Raises
        ------
        ValueError
            As `sample`, and for a device without a filter.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"), acceleration_bandwidth=100.0)
        >>> samples, accelerations = device.sample_filtered([0.1, 0.2])
        >>> f"{accelerations[-1, 0]:.6f} m/s²"
        '28.282938 m/s²'
        """
        if not self._bandwidth:
            raise ValueError("acceleration_bandwidth: this device was made without a filter; give it one")
        checked = checked_times(times, self.time)
        accelerations = np.empty((len(checked), 2))
        return Samples(**self._motion.sampled(checked, accelerations)), accelerations

    def take_events(self) -> np.ndarray:
        """Return the events that ended since the last call, in the order in which they ended; dtype `EVENT_DTYPE`.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> device.advance_to(0.1)
        >>> for event in device.take_events()[:3]:
        ...     print(f"{event['time']:.6f} s {event['kind']}")
        0.000000 s slip_forward
        0.000162 s slip_backward
        0.000191 s unloaded
        """
        return self._motion.events.take()

    @property
    def statistics(self) -> dict:
        """Counts of events by kind; `steps`, the segments of the event loop; `solver.method`, and `solver.step` if the
        method has one; and with `solver.accounts` also `energy_accounts`, a dict of energies since t = 0 [J]:

        - received: `motor_delivered` less `motor_taken_back`, the integrals of `motor_power` where it is positive and
          where the springs drive the motor; `plates`, from their actuators; and `unpaid`, from a push, and in scenes
          without `effects.reaction` from no source, because the masses push the body and do not feel it;
        - lost: `drive_dampers`, `plate_dampers`, `friction` (below 0 where eq. (6) lets it drive the body), `blows` on
          rigid plates with the friction during them, `landings`;
        - `stored`, the change of the energy of masses, body and springs;
        - `residual`, the energy that is received but neither lost nor stored: the solver's error.

        Examples
        --------
        >>> device = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
        >>> device.advance_to(0.1)
        >>> device.statistics["upper_contact"], device.statistics["steps"]
        (2, 84)
        """
        statistics = {**self._motion.events.counts(), "steps": self._motion.steps,
                      "solver.method": self.scene["solver.method"]}
        if self.scene["solver.method"] != "exact":
            statistics["solver.step"] = self.scene["solver.step"]
        if self.scene["solver.accounts"]:
            statistics["energy_accounts"] = self._motion.energy_accounts()
        return statistics
