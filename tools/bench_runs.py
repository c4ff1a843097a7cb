"""The runs that the benchmark times: a scene by the exact solver and by the baseline, its motor running."""

import numpy as np

from vibro_ros.accuracy.baseline import integrate_rk4
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.one_run import simulate
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

#: Step of the baseline [s].
STEP = 1e-5
#: Motor speed [rad/s] commanded at t = 0 of a scene whose motor stands still.
SPEED = 100.0
#: Time [s] from the start over which the baseline's own error is told.
SHORT = 0.2


def moving(scene: Scene) -> Simulator:
    """The scene at t = 0, its motor turning, on command if not by itself."""
    device = Simulator(scene)
    if scene["motor.speed"] == 0.0:
        device.command(motor_speed=SPEED)
    return device


def run_exact(scene: Scene, times: np.ndarray) -> tuple[Samples, np.ndarray]:
    """Samples and events of a scene whose motor turns from t = 0."""
    device = moving(scene)
    return device.sample(times), device.take_events()


def run_baseline(scene: Scene, times: np.ndarray, step: float = STEP) -> np.ndarray:
    """The same by `integrate_rk4`; `times` are those of one rate, from 0."""
    first = simulate(scene, times=np.zeros(1))
    start = np.array([first.upper_position[0], 0.0, first.inclined_position[0], 0.0])
    speed = SPEED if scene["motor.speed"] == 0.0 else None
    return integrate_rk4(scene, start, times[-1], 1.0 / times[1], step, speed)


def baseline_error(scene: Scene) -> float:
    """How far the baseline is off itself [m]: the largest error of a position within `SHORT`, the motor running."""
    scene = scene.with_parameters({"motor.speed": scene["motor.speed"] or SPEED})
    times = 2.0 * STEP * np.arange(round(SHORT / (2.0 * STEP)) + 1)
    exact, found = run_exact(scene, times)[0], run_baseline(scene, times)
    places = (exact.upper_position, exact.inclined_position, exact.body_position, exact.body_height)
    return float(np.abs(found[:, ::2] - np.stack(places, axis=1)).max())
