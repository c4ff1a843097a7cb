"""A Gymnasium environment over the device and its sensors; importing this room registers it.

In come the actions of a policy, motor speed and gaps; out go observations from encoder and tracking, and a reward. The
docstring of `Crawl` is the manual page. The room needs gymnasium, and no ROS.
"""

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Space

from vibro_ros import SAMPLE_FIELDS, Scene, SensedSimulator, default_settings, load_scene, new_figure

PERIOD = 0.2
"""Robot time [s] of a step."""
FASTEST, WIDEST = 150.0, 0.001
"""Motor speed [rad/s] and gap [m] for an action of 1."""
UNIT = 0.1
"""Distance [m] and speed [m/s] that are 1 in an observation and in the reward."""
TARGETS = -0.09, -0.02
"""Range from which the target's speed is drawn [m/s]; it is negative because this robot crawls backwards."""

_MOST = 100.0  # largest magnitude in an observation
_TRUTH = ("body_position", "body_height", "motor_power")
_TRUE = [SAMPLE_FIELDS.index(name) for name in _TRUTH]
_SENSORS = {"sensors.encoder.rate": 1.0 / PERIOD, "sensors.encoder.velocity_window": PERIOD,
            "sensors.tracking.rate": 1.0 / PERIOD}


def relative(measured: Mapping[str, Any]) -> np.ndarray:
    """Return distance, target's speed, crank's speed and last action as numbers near 1; the default observation."""
    numbers = [measured["ahead"] / UNIT, measured["target_speed"] / UNIT, measured["crank_speed"] / 100.0]
    return np.clip([*numbers, *measured["action"]], -_MOST, _MOST).astype(np.float32)


class Crawl(gymnasium.Env[np.ndarray, np.ndarray]):
    """Stay at a target that moves over the ground at a steady speed.

    Robot and target start at the same position, the robot at rest. Its speed over ground is no simple function of the
    motor's: it has a maximum near 105 rad/s, falls to half of it beyond, and depends on the gaps and, at the same
    command, on earlier commands. So no constant command follows every target.

    Action, shape (3,), from -1 to 1
        Motor speed from 0 to 150 rad/s; gaps of the upper and of the inclined plate from 0 to 1 mm. The motor follows
        with the scene's acceleration, the plates with the speed of their actuators.

    Observation
        `observation(measured)`; by default of shape (6,): distance of the robot ahead of the target along x, from
        tracking, in 0.1 m; the target's speed along x, in 0.1 m/s; the crank's speed over the last step, from the
        encoder, in 100 rad/s; and the last action.

    Reward
        Minus the true distance from the target at the end of the step, in 0.1 m. `info` has what another reward needs.

    Episode
        20 s in 100 steps. The target's speed is drawn between -90 and -20 mm/s at the reset, as is the sensors' seed,
        so that the seed of `reset` determines everything. `info` has true values: `body_position`, `body_height` and
        `target_position` [m], and `motor_power` [W], all at the end of the step.

    Parameters
    ----------
    scene : str or Scene
        The robot: a shipped scene's name, a file, or a scene; ValueError if it cannot perform the largest action.
        Encoder and tracking get the rate that a step needs.
    observation : callable
        Returns an observation from a mapping: `ahead` [m], `target_speed` [m/s], `crank_speed` [rad/s] and `action`,
        shape (3,), the last one; and under the name of each sensor that is on, such as `imu`, the values of its last
        measurement, which are missing before the first. Sensors are on by the scene's `sensors.*`.
    observation_space : Space, optional
        The space of other observations than the default.
    render_mode : str, optional
        `rgb_array`: `render` returns a picture with the robot in the middle, and the target.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / PERIOD)}

    def __init__(self, scene: str | Scene = "device",
                 observation: Callable[[Mapping[str, Any]], np.ndarray] = relative,
                 observation_space: Space | None = None, render_mode: str | None = None):
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode: {render_mode!r} is not offered; give rgb_array, or none")
        if (observation is relative) != (observation_space is None):
            raise ValueError("observation, observation_space: give both, or none")
        self.render_mode, self._observe = render_mode, observation
        self._device: SensedSimulator | None = None
        loaded = load_scene(scene) if isinstance(scene, str) else scene
        self._scene = loaded.with_parameters({**_SENSORS, "motor.speed": 0.0})
        try:
            SensedSimulator(self._scene).command(FASTEST, WIDEST, WIDEST)
        except ValueError as error:
            raise ValueError(f"scene {self._scene.name}: cannot perform the largest action, {FASTEST:g} rad/s and gaps "
                             f"of {WIDEST:g} m; give another scene, because {error}") from None
        self.action_space = Box(-1.0, 1.0, (3,), np.float32)
        self.observation_space = observation_space or Box(-_MOST, _MOST, (6,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            Seed of all random numbers from now on.
        options : dict, optional
            `target_speed`: speed of the target [m/s], in place of a drawn one.
        """
        super().reset(seed=seed)
        noise, drawn = int(self.np_random.integers(2**53)), self.np_random.uniform(*TARGETS)
        self._device = SensedSimulator(self._scene.with_parameters({"sensors.seed": float(noise)}))
        self._speed = float((options or {}).get("target_speed", drawn))
        self._steps = 0
        self._measured: dict[str, Any] = {"ahead": 0.0, "target_speed": self._speed, "crank_speed": 0.0,
                                          "action": np.full(3, -1.0)}
        self._sense(self._device)
        return self._observe(self._measured), self._truth(self._device)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Send the commands of an action and simulate one step; an action is clipped to the action space."""
        device = self._begun("step")
        given = np.asarray(action, dtype=float)
        if given.shape != self.action_space.shape or np.isnan(given).any():
            raise ValueError(f"action: {np.array2string(given, threshold=6)} of shape {given.shape} is not three "
                             "numbers; give motor speed, upper gap and inclined gap, each from -1 to 1")
        self._measured["action"] = np.clip(given, -1.0, 1.0)
        speed, upper, inclined = (0.5 * (1.0 + self._measured["action"])).tolist()
        device.command(FASTEST * speed, WIDEST * upper, WIDEST * inclined)
        self._steps += 1
        device.advance_to(self._steps * PERIOD)
        self._sense(device)
        truth = self._truth(device)
        reward = -abs(truth["body_position"] - truth["target_position"]) / UNIT
        return self._observe(self._measured), reward, False, False, truth

    @default_settings()
    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """Return a picture, shape (160, 480, 3): body, ground and target over 1.2 m; None without `render_mode`."""
        if self.render_mode is None:
            return None
        truth = self._truth(self._begun("render"))
        figure = new_figure(4.8, 1.6, 100, layout=None)
        axes = figure.add_axes((0.02, 0.25, 0.96, 0.73))
        place, height = truth["body_position"], truth["body_height"]
        axes.bar(place, 0.06, 0.1, bottom=height, color="tab:blue")
        axes.axvline(truth["target_position"], color="tab:red")
        axes.axhline(0.0, color="black")
        axes.set(xlim=(place - 0.6, place + 0.6), ylim=(-0.02, 0.3), yticks=[])
        axes.text(0.01, 0.85, "x [m]", transform=axes.transAxes)
        figure.canvas.draw()
        return np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()  # type: ignore[attr-defined]

    def _begun(self, method: str) -> SensedSimulator:
        if self._device is None:
            raise ResetNeeded(f"{method}: no episode has begun; call reset() first")
        return self._device

    def _truth(self, device: SensedSimulator) -> dict[str, float]:
        return {**dict(zip(_TRUTH, device.values[_TRUE].tolist(), strict=True)),
                "target_position": self._speed * device.time}

    def _sense(self, device: SensedSimulator) -> None:
        """Read the sensors; where a measurement is late or missing, the previous value stays."""
        for sensor, time, values in device.take_measurements():
            self._measured[sensor] = values
            if sensor == "encoder":
                self._measured["crank_speed"] = values.item(1)
            elif sensor == "tracking":
                self._measured["ahead"] = values.item(0) - self._speed * time


gymnasium.register("vibro_lab/Crawl-v1", entry_point=Crawl, max_episode_steps=100)
