"""A dc motor with its masses, without plates and the reaction: scipy's DOP853 on equations written here once more.

What this module shares with the package is the scene's numbers alone: the sliders, the torque, the modes of bearing and
current loop and the controller's law are written out. Every event ends a run of the integrator.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp


class DcMotor:
    """State y = [θ, θ', i, u, u', w, w'], from rest on the sliders at θ = 0."""

    def __init__(self, scene):
        self.scene, self.law = scene, scene["motor.control"]
        self.constant = scene["motor.gear_ratio"] * scene["motor.torque_constant"]
        self.inertia = scene["motor.gear_ratio"] ** 2 * scene["motor.rotor_inertia"] + scene["motor.crank_inertia"]
        self.resistance, self.inductance = scene["motor.winding_resistance"], scene["motor.winding_inductance"]
        self.supply, self.limit, self.tau = (scene[f"motor.{name}"] for name in (
            "supply_voltage", "current_limit", "current_time_constant"))
        self.friction, self.static = scene["motor.friction"], scene["motor.static_friction"]
        self.target = self.reference = scene["motor.speed"]
        self.slope = self.since = self.integral = self.time = 0.0
        self.held, self.samples, self.loop = scene["motor.voltage"], 0, 0
        self.y = np.array([0.0, self.target, 0.0, self.slider(0.0, "upper")[0], 0.0, self.slider(0.0, "inclined")[0],
                           0.0])
        self.bearing = int(np.sign(self.target))
        self.period = 1.0 / scene["motor.control_rate"]

    def slider(self, angle, side):
        """s, ds/dθ and d²s/dθ²."""
        scene = self.scene
        radius, rod = scene["crank.radius"], scene[f"crank.{side}_rod"]
        psi = angle - (scene["guide.angle"] if side == "inclined" else 0.0)
        sine, cosine = math.sin(psi), math.cos(psi)
        root = math.sqrt(rod**2 - (radius * sine) ** 2)
        return (radius * cosine + root, -radius * sine * (1.0 + radius * cosine / root),
                -radius * cosine - radius**2 * ((cosine**2 - sine**2) / root + (radius * sine * cosine) ** 2 / root**3))

    def mechanism(self, y):
        """Torque of the drives, less that of the linkage's masses; accelerations of the masses; inertia."""
        scene, speed = self.scene, y[1]
        torque, inertia, masses = 0.0, self.inertia + scene["mass.crank_pin"] * scene["crank.radius"] ** 2, []
        for side, q, rate in (("upper", y[3], y[4]), ("inclined", y[5], y[6])):
            s, slope, bend = self.slider(y[0], side)
            pull = (scene[f"{side}.spring.stiffness"] * (q - s)
                    + scene[f"{side}.spring.damping"] * (rate - slope * speed))
            masses.append(-pull / scene[f"mass.{side}"])
            own = scene[f"mass.{side}_slider"]
            torque += pull * slope - own * slope * bend * speed**2
            inertia += own * slope**2
        return torque, masses, inertia

    def current(self, y):
        if self.inductance:
            return y[2]
        if self.law == "speed_by_current" and self.loop == 0:
            return self.held
        voltage = self.loop * self.supply if self.law == "speed_by_current" else self.held
        return (voltage - self.constant * y[1]) / self.resistance

    def wanted_voltage(self, y):
        if not self.inductance:
            return self.constant * y[1] + self.resistance * self.held
        return self.constant * y[1] + self.resistance * y[2] + self.inductance / self.tau * (self.held - y[2])

    def rates(self, time, y):
        torque, masses, inertia = self.mechanism(y)
        current = self.current(y)
        held_still = self.static > 0.0 and self.bearing == 0
        turning = 0.0 if held_still else (self.constant * current - self.scene["motor.damping"] * y[1]
                                          - self.friction * self.bearing + torque) / inertia
        voltage = self.held
        if self.law == "speed_by_current":
            voltage = self.loop * self.supply if self.loop else self.wanted_voltage(y)
        left = voltage - self.resistance * current - self.constant * y[1]
        change = left / self.inductance if self.inductance else 0.0
        return [y[1], turning, change, y[4], masses[0], y[6], masses[1]]

    def command(self, value):
        if self.law == "voltage":
            self.held = value
            return
        reference, _ = self.follow()
        acceleration = self.scene["motor.acceleration"]
        self.reference, self.since, self.target = reference, self.time, value
        self.slope = math.copysign(acceleration, value - reference) if acceleration and value != reference else 0.0

    def follow(self):
        """Reference speed and its slope."""
        moved = self.reference + self.slope * (self.time - self.since)
        return (self.target, 0.0) if self.slope == 0.0 or (self.target - moved) * self.slope <= 0.0 else (
            moved, self.slope)

    def sample(self):
        scene, (reference, slope) = self.scene, self.follow()
        error, gain = reference - self.y[1], scene["motor.proportional_gain"]
        if self.law == "speed_by_voltage":
            wanted = scene["motor.feed_forward"] * reference + gain * error + self.integral
            counter, swing = self.constant * self.y[1], self.resistance * self.limit
            self.held = min(max(min(max(wanted, counter - swing), counter + swing), -self.supply), self.supply)
            winds_up = self.held != wanted and error * (wanted - self.held) > 0.0
        else:
            wanted = scene["motor.feed_forward"] * slope + gain * error + self.integral
            self.held = min(max(wanted, -self.limit), self.limit)
            winds_up = self.held != wanted and error * wanted > 0.0
        if not winds_up:
            self.integral += scene["motor.integral_gain"] * self.period * error
        self.samples += 1

    def advance(self, until):
        while self.time < until - 1e-14:
            due = math.inf if self.law == "voltage" else self.samples * self.period
            if due <= self.time + 1e-14:
                self.sample()
                continue
            self._choose_modes()
            found = solve_ivp(self.rates, (self.time, min(until, due)), self.y, method="DOP853", rtol=3e-14,
                              atol=1e-15, events=self._events())
            self.time, self.y = float(found.t[-1]), found.y[:, -1].copy()
            if self.static and len(found.t_events[0]):
                self._pass_bearing()
        self._choose_modes()
        self.y[2] = self.current(self.y)
        return self.y

    def _choose_modes(self):
        if self.law == "speed_by_current":
            wanted = self.wanted_voltage(self.y)
            self.loop = 1 if wanted > self.supply else -1 if wanted < -self.supply else 0
        if self.static and self.bearing == 0:
            torque = self.constant * self.current(self.y) + self.mechanism(self.y)[0]
            self.bearing = int(np.sign(torque)) if abs(torque) > self.static * (1.0 + 1e-13) else 0

    def _pass_bearing(self):
        if self.bearing:
            self.y[1] = 0.0
        torque = self.constant * self.current(self.y) + self.mechanism(self.y)[0]
        self.bearing = int(np.sign(torque)) if not self.bearing or abs(torque) > self.static else 0

    def _events(self):
        events = []
        if self.static:
            bearing = self.bearing
            events.append((lambda time, y: bearing * y[1]) if bearing else (
                lambda time, y: self.static - abs(self.constant * self.current(y) + self.mechanism(y)[0])))
        if self.law == "speed_by_current":
            loop = self.loop
            events.append((lambda time, y: loop * self.wanted_voltage(y) - self.supply) if loop else (
                lambda time, y: self.supply - abs(self.wanted_voltage(y))))
        for event in events:
            event.terminal, event.direction = True, -1
        return events
