"""One mass on a damped drive that strikes a rigid plate at rest once a turn: its orbits in closed form.

Between blows the motion is linear, so that for each phase of the blow exactly one gap and one speed let it repeat
itself: the branch of orbits is a curve that the phase of the blow parametrises. (The idea is that of S. W. Shaw and
P. J. Holmes, J. Sound Vib. 90 (1983), for a sinusoidal drive; here the drive is the slider's, by its Fourier series.)
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

import vibro_ros
from vibro_ros.model.slider import Slider

HARMONICS = 64


class OrbitBlow(NamedTuple):
    """The one orbit whose blow falls on a phase: the gap [m] and the speed before the blow [m/s]."""

    gap: float
    speed: float


@dataclass
class ImpactOscillator:
    """The upper mass of `scene` alone."""

    scene: vibro_ros.Scene

    def __post_init__(self):
        scene, angles = self.scene, np.arange(4 * HARMONICS) * 2.0 * math.pi / (4 * HARMONICS)
        self.rod, self.restitution = scene["crank.upper_rod"], scene["upper.plate.restitution"]
        self.speed, mass = scene["motor.speed"], scene["mass.upper"]
        self.period = 2.0 * math.pi / self.speed
        stiffness, damping = scene["upper.spring.stiffness"] / mass, scene["upper.spring.damping"] / mass
        self.matrix = np.array([[0.0, 1.0], [-stiffness, -damping]])
        self.turn = expm(self.matrix * self.period)
        slider = np.fft.rfft(Slider(scene["crank.radius"], self.rod, 0.0).position(angles)) / (2 * HARMONICS)
        rate = 1j * self.speed * np.arange(HARMONICS)
        self._steady = slider[:HARMONICS] * (stiffness + damping * rate) / (rate**2 + damping * rate + stiffness)
        self._steady[0] *= 0.5
        self._rate = rate

    def steady(self, phase: float) -> tuple[float, float, float]:
        """Return position, velocity and acceleration of the steady motion without a plate."""
        turned = self._steady * np.exp(self._rate * phase / self.speed)
        return tuple(float(np.sum(turned * self._rate**order).real) for order in range(3))

    def blow(self, phase: float) -> OrbitBlow:
        """From d = M11 d + M12 (-e v - b), v - b = M21 d + M22 (-e v - b): d from the steady motion to the plate, b the
        steady velocity, v the speed before the blow, M = e^(A T)."""
        (m11, m12), (m21, m22) = self.turn
        position, velocity, _ = self.steady(phase)
        equations = [[1.0 - m11, self.restitution * m12], [-m21, 1.0 + self.restitution * m22]]
        distance, speed = np.linalg.solve(equations, [-m12 * velocity, (1.0 - m22) * velocity])
        return OrbitBlow(position + distance - self.rod, speed)

    def multipliers(self, phase: float) -> np.ndarray:
        """Eigenvalues of e^(A T) S, with the jump S of the blow."""
        gap, speed = self.blow(phase)
        position, velocity, acceleration = self.steady(phase)
        state = np.array([gap + self.rod - position, 0.0])
        acceleration_before, acceleration_after = (acceleration + self.matrix[1] @ (state + [0.0, moving - velocity])
                                                   for moving in (speed, -self.restitution * speed))
        slope = (acceleration_after + self.restitution * acceleration_before) / speed
        jump = np.array([[-self.restitution, 0.0], [slope, -self.restitution]])
        return np.linalg.eigvals(self.turn @ jump)

    def phases_where(self, test, count: int = 2000) -> list[float]:
        """Phases of physical blows, at positive speed, at which `test` of the phase changes its sign."""
        phases = np.linspace(0.0, 2.0 * math.pi, count)
        values = np.array([test(phase) if self.blow(phase).speed > 0.0 else np.nan for phase in phases])
        crossings = np.flatnonzero(values[1:] * values[:-1] < 0.0)
        return [brentq(test, phases[i], phases[i + 1], xtol=1e-14) for i in crossings]

    def doublings(self) -> list[float]:
        """Phases of the blow at period doublings."""
        return self.phases_where(lambda phase: float(np.prod(self.multipliers(phase) + 1.0).real))

    def folds(self) -> list[float]:
        """Phases of the blow at folds of the gap."""
        return self.phases_where(lambda phase: float(np.prod(self.multipliers(phase) - 1.0).real))
