"""Orbits of machines with a dc motor: known multipliers, another integrator, the ideal motor, the Sommerfeld effect."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vibro_lab
import vibro_ros
from vibro_lab.orbits.chaos import exponent_of_pairs
from vibro_lab.orbits.orbit import derivative
from vibro_lab.orbits.recurrence import JITTER
from vibro_lab.orbits.turn_map import TurnMap, crank_speed
from vibro_ros.model.slider import Slider
from vibro_ros.simulation.motion import SimulationError

VOLTS = {"effects.motor": "dc", "motor.control": "voltage", "motor.voltage": 15.0, "motor.speed": 90.0,
         "motor.friction": 0.0, "motor.static_friction": 0.0}
WINDING = {"motor.winding_inductance": 0.05}
ALONE = {"effects.upper_mass": False, "effects.inclined_mass": False}
#: As the page on the motor has it: without plates and flywheel, on a winding of 3 ohm.
SOMMERFELD = {"effects.upper_contact": "none", "effects.inclined_contact": "none", "mass.upper_slider": 0.0,
              "mass.inclined_slider": 0.0, "motor.control": "voltage", "motor.winding_resistance": 3.0,
              "motor.supply_voltage": 60.0, "motor.crank_inertia": 3.5e-5}


def scene(name, *changes):
    together = {}
    for change in changes:
        together |= change
    return vibro_ros.load_scene(name).with_parameters(together)


def machine(**changes):
    return scene("machine", {"motor.speed": 100.0} | changes)


def motor_numbers(robot):
    """K, J, R, L and b."""
    ratio, inertia = robot["motor.gear_ratio"], robot["motor.crank_inertia"]
    return (ratio * robot["motor.torque_constant"], ratio**2 * robot["motor.rotor_inertia"] + inertia,
            robot["motor.winding_resistance"], robot["motor.winding_inductance"], robot["motor.damping"])


def in_order(values):
    return np.array(sorted(np.asarray(values, dtype=complex), key=lambda z: (-round(abs(z), 9), z.imag)))


@pytest.mark.parametrize("winding", [{}, WINDING], ids=["L = 0", "L"])
def test_a_motor_without_load_has_the_multipliers_of_its_run_up(winding):
    """A64. θ' = K V/(R b + K²); exp(-T/τ) with τ = J/(b + K²/R), or the exponentials of the two roots of
    L J p² + (R J + L b) p + R b + K²."""
    robot = scene("paper", VOLTS, ALONE, winding)
    constant, inertia, resistance, inductance, b = motor_numbers(robot)
    speed = constant * 15.0 / (resistance * b + constant**2)
    roots = (np.roots([inductance * inertia, resistance * inertia + inductance * b, resistance * b + constant**2])
             if inductance else np.array([-(b + constant**2 / resistance) / inertia]))
    orbit = vibro_lab.find_orbit(robot)
    assert orbit.state.motor_speed == pytest.approx(speed, rel=1e-12)
    assert orbit.period == pytest.approx(2.0 * math.pi / speed, rel=1e-12)
    # Central differences over 1e-5: their own error is 1e-10 of the curvature, rounding 1e-16 / 1e-5.
    assert in_order(orbit.multipliers) == pytest.approx(in_order(np.exp(roots * orbit.period)), abs=1e-9)
    spectrum = vibro_lab.lyapunov_spectrum(robot)
    assert spectrum.exponents == pytest.approx(np.sort(roots.real)[::-1], abs=1e-4)


def section_map(robot, phase, state):
    """Return the state after a turn from [u, u', θ', i], with the upper mass alone and no plates, by DOP853 with an
    event of its own.
    """
    constant, inertia, resistance, inductance, b = motor_numbers(robot)
    slider, mass = Slider(robot["crank.radius"], robot["crank.upper_rod"], 0.0), robot["mass.upper"]

    def rate(time, y):
        slope = slider.slope(y[2])
        pull = (robot["upper.spring.stiffness"] * (y[0] - slider.position(y[2]))
                + robot["upper.spring.damping"] * (y[1] - slope * y[3]))
        return [y[1], -pull / mass, y[3], (constant * y[4] - b * y[3] + pull * slope) / inertia,
                (robot["motor.voltage"] - resistance * y[4] - constant * y[3]) / inductance]

    def passes(time, y):
        return y[2] - phase - 2.0 * math.pi
    passes.terminal, passes.direction = True, 1.0
    solution = solve_ivp(rate, (0.0, 1.0), [*state[:2], phase, *state[2:]], method="DOP853", rtol=1e-13, atol=1e-14,
                         events=passes)
    return solution.y[[0, 1, 3, 4], -1], solution.t[-1]


def test_the_map_of_a_section_is_that_of_another_integrator():
    """An orbit with 29 % of ripple, its period, and the derivative by central differences of that integrator's map."""
    robot = scene("unilateral", VOLTS, WINDING, {"effects.inclined_mass": False, "effects.upper_contact": "none",
                                                 "upper.spring.damping": 3.0, "motor.crank_inertia": 2e-4})
    orbit = vibro_lab.find_orbit(robot)
    turn_map = TurnMap(robot, orbit.state.crank_angle)
    names = ("upper_position", "upper_velocity", "motor_speed", "motor_current")
    assert turn_map.names == names
    state = np.array([getattr(orbit.state, name) for name in names])
    after, period = section_map(robot, turn_map.phase, state)
    assert after == pytest.approx(state, rel=1e-10)  # the integrator's own error over a turn
    assert orbit.period == pytest.approx(period, rel=1e-11)
    matrix = np.empty((4, 4))
    for k, unit in enumerate(turn_map.units):
        step = 1e-4 * unit * np.eye(4)[k]
        ends = [section_map(robot, turn_map.phase, state + sign * step)[0] for sign in (1.0, -1.0)]
        matrix[:, k] = (ends[0] - ends[1]) / 2e-4 / turn_map.units
    by_device, _ = derivative(turn_map, turn_map.read(orbit.state))
    assert by_device == pytest.approx(matrix, abs=1e-6)  # 1e-4² of the curvature
    assert in_order(orbit.multipliers) == pytest.approx(in_order(np.linalg.eigvals(matrix)), abs=1e-6)


def test_a_heavy_flywheel_has_the_orbit_and_the_multipliers_of_the_ideal_motor():
    """A67. Off by O(1/J); and one more multiplier, which nears 1 as exp(-T (b + K²/R)/J) does, but for the part of the
    masses' torque that changes with the speed."""
    differences = []
    for inertia in (0.2, 0.4):
        robot = scene("damped", VOLTS, {"motor.crank_inertia": inertia, "motor.speed": 100.0, "motor.voltage": 16.35})
        orbit = vibro_lab.find_orbit(robot)
        turning = 2.0 * math.pi / orbit.period
        ideal = robot.with_parameters({"effects.motor": "ideal", "motor.speed": turning})
        ideal_map = TurnMap(ideal, orbit.state.crank_angle)
        state = ideal_map.read(orbit.state)
        closes = vibro_lab.find_orbit(ideal)
        differences.append([abs(orbit.mean_speed / closes.mean_speed - 1.0),
                      np.abs(orbit.multipliers[1:3] - closes.multipliers[:2]).max(),
                      np.abs(ideal_map(state).state - state).max()])
        constant, total_inertia, resistance, _, b = motor_numbers(robot)
        rate = -math.log(orbit.multipliers[0].real) / orbit.period
        assert rate * total_inertia == pytest.approx(b + constant**2 / resistance, rel=0.5)
    assert np.array(differences[0]) / differences[1] == pytest.approx(2.0, rel=0.05)
    assert max(differences[1]) < 1e-2


def test_the_fall_of_the_sommerfeld_effect_is_a_fold():
    """A70: going down, the speed falls between 36 and 34 V. Along the branch the voltage turns back there, at some
    140 rad/s, while the speed goes on to fall."""
    start = vibro_lab.find_orbit(scene("machine", SOMMERFELD, {"motor.voltage": 38.4, "motor.speed": 190.0}))
    branch = vibro_lab.follow_orbit(start, "motor.voltage", 26.0, 60.0, upwards=False, points=16)
    fold, = (special for special in branch.special_points if special.kind == "fold")
    assert 34.0 < fold.value < 36.0 and fold.width < 1e-8
    assert np.abs(fold.multipliers - 1.0).min() < 1e-5
    speeds = branch.strobe["motor_speed"][:, 0]
    assert (np.diff(speeds) < 0.0).all()
    assert branch.values[-1] > fold.value and branch.values.min() >= fold.value


def test_a_pair_of_runs_parts_by_the_voltage():
    """The 1-turn orbit at 40 V attracts: no pair parts."""
    robot = scene("machine", SOMMERFELD, {"motor.voltage": 40.0, "motor.speed": 200.0})
    exponent, hidden = exponent_of_pairs(vibro_ros.Simulator(robot), 4.0, 2.0)
    assert exponent == 0.0 and hidden < 5.0


@pytest.mark.parametrize("call", [vibro_lab.find_orbit, vibro_lab.lyapunov_spectrum])
def test_a_controller_that_takes_samples_closes_no_orbit(call):
    with pytest.raises(ValueError, match="motor.control: speed_by_current takes samples 1000 times a second.*"
                                         "choose voltage, or effects.motor ramp; settled_motion"):
        call(machine())


def test_motions_of_a_controller_are_told_within_the_jitter_of_its_samples():
    """Motions are recognised within the jitter of the controller's samples. Three starts, one of which is at another
    instant between two samples; a device that runs on has the mean speed, and its states at the cut stay within the
    tolerance of the found states.
    """
    motions = [vibro_lab.settled_motion(machine(), **start)
               for start in ({}, {"crank_angle": 0.1234}, {"motor_speed": 80.0, "body_velocity": 0.5})]
    assert [motion.turns for motion in motions] == [2, 2, 2]
    assert all(motion.is_same(motions[0]) for motion in motions)
    device = vibro_ros.Simulator(machine())
    device.advance_to(20.0)
    begin = device.state.body_position
    device.advance_to(20.0 + 400 * math.pi / 100.0)
    mean = (device.state.body_position - begin) / (4.0 * math.pi)
    assert motions[0].mean_speed == pytest.approx(mean, rel=1e-3)
    turn_map = TurnMap(machine(), 1.0)
    states = turn_map.cuts(device, 200).states
    assert max(np.ptp(states[half::2], axis=0).max() for half in (0, 1)) < 0.5 * JITTER
    assert np.ptp(states, axis=0).max() > 10.0 * JITTER  # its two turns are not motion


def test_a_crank_that_does_not_come_round_is_told():
    """2 V turn a crank without load, but not against the pressed masses; the error says so."""
    robot = machine(**{"motor.control": "voltage", "motor.voltage": 2.0, "motor.speed": 0.0})
    with pytest.raises(SimulationError, match="the crank has not come round for .* give more than 2 for "
                                              "motor.voltage"):
        vibro_lab.settled_motion(robot)
    with pytest.raises(ValueError, match="motor.voltage: 0.2 V turns no crank forwards; give more than 0.291"):
        vibro_lab.find_orbit(robot.with_parameters({"motor.voltage": 0.2}))


def test_the_unit_of_speed_at_a_voltage_is_that_without_load():
    robot = scene("paper", VOLTS, ALONE)
    assert crank_speed(robot) == pytest.approx(vibro_lab.find_orbit(robot).state.motor_speed, rel=1e-12)
