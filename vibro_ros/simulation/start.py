"""The start of a motion: where everything stands at t = 0, as `start.state` has it."""

import math

import numpy as np

from vibro_ros.model.scene import Scene, given_start
from vibro_ros.model.tables import Model
from vibro_ros.simulation.energy_accounts import open_accounts
from vibro_ros.simulation.given_state import place
from vibro_ros.solver.energy import stored_energy
from vibro_ros.solver.segment import read_signals
from vibro_ros.solver.state import State, new_state


def started(scene: Scene, model: Model, point: np.ndarray) -> State:
    """The solver's state at t = 0, before its first segment.

    Parameters
    ----------
    scene, model : Scene, Model
        What is simulated, and the same compiled.
    point : ndarray, shape (channels,)
        All channels, overwritten: positions and velocities are those of the start.
    """
    system, forms, channels = model.system, model.forms, model.forms.channels
    plates = {side: scene[f"crank.{side}_rod"] + scene[f"{side}.gap"] for side in forms.plates}
    state = new_state(system, scene["motor.speed"], np.array([plates[side] for side in forms.plates]),
                      model.initial_mode)
    point[:], point[channels.one] = 0.0, 1.0
    if scene["start.state"] == "given":
        place(scene, model, state, point, given_start(scene) | {"motor_speed": scene["motor.speed"]}, turned=True)
    else:
        # The very bits that the flow uses: a mass at rest on its slider must feel no force at all.
        sliders = point[channels.signal(0):channels.signal(len(model.sliders))]
        read_signals(system, state, sliders)
        point[channels.ramp(0):channels.ramp(channels.ramps)] = state.ramp["value"]
        if scene["start.state"] == "rest":
            for i, side in enumerate(forms.guides):
                point[i] = min(sliders[i], plates.get(side, math.inf))
    state.now["audit"]["energy"] = stored_energy(system, point[:2 * channels.coordinates])
    if scene["solver.accounts"]:
        open_accounts(model, state, point)
    return state
