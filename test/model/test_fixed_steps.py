"""Methods of fixed step: their orders of convergence, what they compute exactly, and what they may miss."""

import numpy as np
import pytest

import vibro_ros

METHODS = ("rk4", "rk4_located")
SMOOTH = {"effects.friction": "none", "effects.upper_contact": "none", "effects.inclined_contact": "none",
          "upper.spring.damping": 2.0, "inclined.spring.damping": 2.0}
TURNING = {"motor.speed": 100.0}
POSITIONS = ("upper_position", "inclined_position", "body_position")


def scene(name, changes=None):
    return vibro_ros.load_scene(name).with_parameters(TURNING | (changes or {}))


def errors(made, method, step, end=0.1):
    """Largest errors of the positions [m] over `end` seconds."""
    times = np.linspace(0.0, end, 101)
    exact = vibro_ros.simulate(made, times=times)
    run = vibro_ros.simulate(made.with_parameters({"solver.method": method, "solver.step": step}), times=times)
    return np.array([np.abs(getattr(run, name) - getattr(exact, name)).max() for name in POSITIONS])


def order(made, method, steps):
    """Return the slope of log(error) over log(step) through many steps, for each position."""
    errors_by_step = [errors(made, method, step) for step in steps]
    return np.polyfit(np.log(steps), np.log(errors_by_step), 1)[0]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("changes", [{}, {"effects.reaction": True, "effects.mass_weight": True}])
def test_order_without_events(method, changes):
    """A28. The next power adds a share of a few per cent at these steps."""
    orders = order(scene("unilateral", SMOOTH | changes), method, [2e-3, 1e-3, 5e-4, 2.5e-4])
    np.testing.assert_allclose(orders, 4.0, rtol=0, atol=0.1)


@pytest.mark.parametrize("name", ["rigid", "device", "unilateral"])
def test_order_four_when_events_are_located(name):
    """A28. A contact of 0.3 ms needs steps below 1e-5 s to show the order, rigid plates far longer ones."""
    steps = np.geomspace(2e-3, 5e-4, 5) if name == "rigid" else np.geomspace(1e-5, 2e-6, 8)
    orders = order(scene(name), "rk4_located", steps)
    assert np.mean(orders[:2]) > 3.5, orders


@pytest.mark.parametrize("name", ["rigid", "device"])
def test_order_one_when_events_are_crossed_blindly(name):
    """A28. The position of an event within its step scatters the errors by a factor of a few, and therefore the slope
    through 24 steps over two decades by 0.2; a fourth order would be far away.
    """
    orders = order(scene(name), "rk4", np.geomspace(1e-4, 1e-6, 24))
    assert 0.7 < np.mean(orders[:2]) < 1.3, orders


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["rigid", "device"])
def test_commands_between_the_steps_act_as_they_do_exactly(method, name):
    """First order: at 5e-7 s what an event is off by stays below 1e-3 m within 0.08 s."""
    ends = []
    for solver in ({}, {"solver.method": method, "solver.step": 5e-7}):
        device = vibro_ros.Simulator(scene(name, {"effects.motor": "lag", **solver}))
        device.advance_to(0.01234567)
        device.command(motor_speed=60.0, upper_gap=0.0002)
        device.advance_to(0.08)
        ends.append(device.state)
    assert ends[1].crank_angle == pytest.approx(ends[0].crank_angle, abs=1e-10)  # rad; 160000 roundings of it
    assert ends[1].motor_speed == pytest.approx(ends[0].motor_speed, abs=1e-10)
    assert ends[1].upper_plate_position == pytest.approx(ends[0].upper_plate_position, abs=1e-15)
    for position in POSITIONS:
        assert getattr(ends[1], position) == pytest.approx(getattr(ends[0], position), abs=1e-3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("friction", ["coulomb", "static"])
def test_a_body_at_rest_has_a_speed_of_exactly_0(method, friction):
    made = scene("no_impact", {"motor.speed": 60.0, "effects.friction": friction, "ground.friction": 0.5,
                               "ground.static_friction": 0.6, "solver.step": 1e-4})
    run = vibro_ros.simulate(made, duration=1.0, rate=1e4, method=method)
    events = run.events[np.isin(run.events["kind"], ["stick", "slip_forward", "slip_backward"])]
    stuck = [(begun["time"], ended["time"]) for begun, ended in zip(events[:-1], events[1:], strict=True)
             if begun["kind"] == "stick"]
    assert sum(ended - begun for begun, ended in stuck) > 0.1  # s
    for begun, ended in stuck:
        within = (run.time > begun + 1e-9) & (run.time < ended - 1.5e-4)  # s; the last step ends in slip
        assert not np.any(run.body_velocity[within])


@pytest.mark.parametrize(("name", "method"), [("damped", "rk4"), ("machine", "rk4"), ("machine", "rk4_located")])
def test_a_step_that_is_too_long_ends_the_run(name, method):
    """A step of three of the contact's time constants; and a dc motor that diverges, whose crank would have 1e300 turns
    to count."""
    with pytest.raises(vibro_ros.SimulationError, match=f"{method} may need a solver.step below 0.001 s"):
        vibro_ros.simulate(scene(name, {"solver.step": 1e-3}), duration=5.0, rate=100.0, method=method)


RIGID = {"effects.upper_contact": "restitution", "effects.inclined_contact": "restitution"}
STRIBECK = {"effects.friction": "stribeck", "ground.static_friction": 0.5, "ground.stribeck_speed": 0.05}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("name", "changes"), [
    ("no_impact", STRIBECK | {"effects.normal_force": "printed"}), ("device", RIGID),
    ("damped", STRIBECK | {"effects.reaction": True, "ground.viscous_friction": 2.0}),
    ("device", {"effects.friction": "none"}), ("rigid", {"effects.reaction": True, "effects.normal_force": "weight"}),
    ("paper", {"effects.reaction": True}), ("device", {"effects.inclined_mass": False}),
    ("damped", {"effects.adhesion": True}),
    ("device", {"ground.slope": 0.05, "ground.viscous_friction": 2.0, "ground.drag": 0.3}),
    ("damped", {"effects.misprint": True, "inclined.plate.stiffness": 1e5})])
def test_every_effect_converges_to_the_exact_motion(method, name, changes):
    """A28. A step shorter by a factor of ten reduces a first-order error by ten, apart from the scatter by the
    positions of events within steps.
    """
    coarse, fine = (errors(scene(name, changes), method, step) for step in (1e-5, 1e-6))
    assert fine.max() < 1e-3  # m
    at_rounding = 1e-10 if method == "rk4_located" else 0.0  # m
    assert fine.max() < max(0.5 * coarse.max(), at_rounding)
