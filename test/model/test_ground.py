"""The ground: known answers A52 to A56, by the public interface."""

import math

import numpy as np
import pytest
from commanded_device import changed
from landing_by_impulse import struck

import vibro_ros

GRAVITY = 9.81
#: A block: no masses, so that its own speed and the ground's forces are all there is.
BLOCK = {"effects.upper_mass": False, "effects.inclined_mass": False, "effects.normal_force": "weight",
         "start.state": "given"}
#: A body whose masses do nothing, which hops.
BALL = {"effects.upper_contact": "none", "effects.inclined_contact": "none", "upper.spring.stiffness": 0.0,
        "inclined.spring.stiffness": 0.0, "effects.normal_force": "hop", "start.state": "given",
        "start.upper_position": 0.06, "start.inclined_position": 0.06}


def paper(*changes):
    return changed("paper", *changes)


def simulated(duration, *changes, rate=1000.0):
    return vibro_ros.simulate(paper(*changes), duration=duration, rate=rate)


def instants_of(run, kind):
    """Instants [s] of the events of one kind."""
    return run.events["time"][run.events["kind"] == kind]


def test_a_block_runs_up_a_slope_and_stays():
    """A52. v0/G and v0²/2G, G = g (sin α + μ cos α); it stays, because tan α < μ."""
    slope, friction, speed = 0.1, 0.2, 1.0
    rate = GRAVITY * (math.sin(slope) + friction * math.cos(slope))
    run = simulated(1.0, BLOCK, {"ground.slope": slope, "start.body_velocity": speed})
    assert instants_of(run, "stick") == pytest.approx([speed / rate], abs=1e-15)
    assert run.body_position[-1] == pytest.approx(speed**2 / 2.0 / rate, abs=1e-15)
    assert run.body_velocity[-1] == 0.0
    assert run.normal_force == pytest.approx(GRAVITY * math.cos(slope), rel=1e-15)


@pytest.mark.parametrize("viscous", [1e-3, 3.0, 1e4])
def test_a_block_runs_up_a_slope_through_oil(viscous):
    """A52. With γ = c_v/M: ln(1 + γ v0/G)/γ, and v0/γ − (G/γ²) ln(1 + γ v0/G)."""
    slope, friction, speed = 0.1, 0.2, 1.0
    rate = GRAVITY * (math.sin(slope) + friction * math.cos(slope))
    run = simulated(0.5, BLOCK, {"ground.slope": slope, "ground.viscous_friction": viscous,
                                 "start.body_velocity": speed})
    share = viscous * speed / rate  # of the oil in the first deceleration
    assert instants_of(run, "stick") == pytest.approx([math.log1p(share) / viscous], abs=1e-15)
    way = (speed / viscous) * ((share - math.log1p(share)) / share)
    assert run.body_position[-1] == pytest.approx(way, abs=1e-12 if viscous < 1.0 else 1e-15)


def test_a_block_slides_down_at_its_terminal_speed():
    """A52. M g (sin α − μ cos α)/c_v."""
    run = simulated(20.0, BLOCK, {"ground.slope": 0.5, "ground.viscous_friction": 3.0}, rate=10.0)
    limit = GRAVITY * (math.sin(0.5) - 0.2 * math.cos(0.5)) / 3.0
    assert run.body_velocity[-1] == pytest.approx(-limit, abs=1e-14)


@pytest.mark.parametrize(("drag", "goes_back"), [(1.9, False), (3.0, True)])
def test_a_load_stops_a_block_and_may_pull_it_back(drag, goes_back):
    """A53. v' = −(μ g + F_0/M) until the stop, and then, where F_0 > μ M g, −(F_0/M − μ g)."""
    stop = 1.0 / (drag + 0.2 * GRAVITY)
    run = simulated(1.0, BLOCK, {"ground.drag": drag, "start.body_velocity": 1.0})
    assert instants_of(run, "slip_backward" if goes_back else "stick") == pytest.approx([stop], abs=1e-15)
    back = (drag - 0.2 * GRAVITY) * (1.0 - stop) if goes_back else 0.0
    assert run.body_velocity[-1] == pytest.approx(-back, abs=1e-14)
    assert run.friction_force[-1] == pytest.approx(-0.2 * GRAVITY if goes_back else -drag, abs=1e-14)


def test_forwards_and_backwards_each_have_their_friction():
    """A53. The block stops after v0/(μ g), with the μ of its direction."""
    for speed, friction in ((1.0, 0.2), (-1.0, 0.5)):
        run = simulated(1.0, BLOCK | {"ground.drag": 1e-20}, {  # a drag, so that x is a coordinate
            "ground.friction_backward": 0.5, "start.body_velocity": speed})
        assert instants_of(run, "stick") == pytest.approx([1.0 / (friction * GRAVITY)], abs=1e-15)


def test_a_one_way_wheel_never_rolls_back():
    """A53. By the rule `weight` the body of the paper's robot moves forward or stands, and the friction that locks it
    equals the push of its masses.
    """
    run = simulated(1.0, {"effects.normal_force": "weight", "ground.friction": 0.01, "ground.friction_backward": 1e6})
    assert (run.body_velocity >= 0.0).all() and run.body_position[-1] > 0.01
    assert np.count_nonzero(run.body_velocity == 0.0) > 10
    assert run.friction_force.min() < -9.0  # 80 times what the friction of forward motion is


@pytest.mark.parametrize(("speed", "friction"), [(1.0, 0.2), (-1.0, 0.5), (0.0, 0.2)])
def test_a_body_bounces_to_rest(speed, friction):
    """A54. Landings at eᵏ√(2gh); each takes μ (1 + e) of its speed from x' until the body stands; rest after
    √(2h/g)(1 + e)/(1 − e)."""
    height, restitution = 0.1, 0.7
    run = simulated(2.0, BALL, {"ground.restitution": restitution, "start.body_height": height,
                                "start.body_velocity": speed, "ground.friction_backward": 0.5})
    landings = run.events[run.events["kind"] == "landing"]
    fall, first = math.sqrt(2.0 * GRAVITY * height), math.sqrt(2.0 * height / GRAVITY)
    powers = restitution ** np.arange(len(landings))
    assert landings["speed"] == pytest.approx(fall * powers, abs=1e-14)
    assert landings["time"] == pytest.approx(
        first + 2.0 * first * restitution * (1.0 - powers) / (1.0 - restitution), abs=1e-14)
    assert landings["speed"][-1] <= 1e-9 < landings["speed"][-2]
    place, left = speed * first, abs(speed)
    for power in powers:
        left = max(0.0, left - friction * (1.0 + restitution) * fall * power)
        place += math.copysign(left, speed) * 2.0 * restitution * fall * power / GRAVITY
    assert run.body_position[-1] == pytest.approx(place, abs=1e-14)
    assert (run.body_height[-1], run.body_vertical_velocity[-1], run.body_velocity[-1]) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("restitution", [0.0, 0.6])
@pytest.mark.parametrize("speed", [-2.0, -0.3, -0.02, 0.0, 0.02, 0.3, 2.0])
@pytest.mark.parametrize(("angle", "friction", "backward"), [
    (0.8, 0.2, 0.2), (0.8, 0.003, 0.003), (2.2, 0.3, 0.01), (2.2, 0.001, 0.6), (1.2, 0.05, 0.4)])
def test_a_landing_is_poissons(angle, friction, backward, speed, restitution):
    """A55. The speeds after a landing on one mass that feels it, of a body that slips on, stops, or is turned back
    while the ground is compressed or rebounds."""
    fall, mass = 0.5, 0.6
    scene = paper(BALL, {
        "effects.upper_mass": False, "start.upper_position": 0.0, "mass.inclined": mass, "effects.reaction": True,
        "guide.angle": angle, "ground.friction": friction, "ground.friction_backward": backward,
        "ground.restitution": restitution, "start.body_velocity": speed, "start.body_height": 1e-13,
        "start.body_vertical_velocity": -fall})
    direction = np.array([-math.sin(angle), math.cos(angle)])
    inertia = 1.6 * np.eye(2) - mass * np.outer(direction, direction)
    expected = struck(inertia, speed, fall, (friction, backward), (friction, backward), restitution)
    device = vibro_ros.Simulator(scene)
    device.advance_to(1e-12)
    speeds_after = np.array([device.state.body_velocity, device.state.body_vertical_velocity])
    assert speeds_after == pytest.approx(expected, abs=1e-10)  # gravity in 1e-12 s
    mass_speed = -direction @ (speeds_after - (speed, -fall))  # a free mass keeps its speed in space
    assert device.state.inclined_velocity == pytest.approx(mass_speed, abs=1e-10)
    assert device.take_events()["kind"][0] == "landing"
