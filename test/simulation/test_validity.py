"""The pitch index and the current of the winding over its limit: known values, an independent integral, and limits."""

import numpy as np
import pytest

import vibro_ros
from vibro_ros.simulation.validity import validity_of


def device(**changes):
    return vibro_ros.load_scene("device").with_parameters(
        {"motor.speed": 100.0, **{name.replace("__", "."): value for name, value in changes.items()}})


def validity(scene, duration=4.0, rate=2e4):
    return validity_of(scene, vars(vibro_ros.simulate(scene, duration=duration, rate=rate)))


@pytest.mark.parametrize("rate", [2e4, 200.0])
@pytest.mark.parametrize(("offset", "known"), [(0.0, 0.06), (0.03, 0.8)])
def test_the_known_indices_of_device(offset, known, rate):
    assert validity(device(body__crank_offset=offset), rate=rate).pitch_index == pytest.approx(known, rel=0.2)


def test_the_index_is_the_double_integral_of_the_moment():
    """For a given flight, compared with the sum of m p × (a + g) itself: the masses swing and the body falls freely."""
    scene = device(body__crank_offset=0.01)
    t = np.linspace(0.0, 0.05, 20_001)
    places = {"upper": 0.05 + 0.004 * np.sin(60.0 * t), "inclined": 0.06 + 0.003 * np.cos(90.0 * t)}
    total, masses = scene.total_mass, {side: scene[f"mass.{side}"] for side in places}
    rates = {side: np.gradient(q, t, edge_order=2) for side, q in places.items()}
    pushes = {side: np.gradient(v, t, edge_order=2) for side, v in rates.items()}
    upwards = {side: scene.direction(side)[1] for side in places}
    along = {side: scene.direction(side)[0] for side in places}
    gravity = scene["gravity"]
    body = [-sum(masses[s] * pushes[s] * e[s] for s in places) / total for e in (along, upwards)]  # a_G + g
    moment = 0.0
    for side, q in places.items():
        a = [body[0] + pushes[side] * along[side], body[1] + pushes[side] * upwards[side]]
        moment = moment - masses[side] * (along[side] * q * a[1] - (upwards[side] * q + 0.01) * a[0])

    def integral(f):
        return np.concatenate([[0.0], np.cumsum(np.diff(t) * (f[1:] + f[:-1]) / 2.0)])

    momentum = sum(masses[s] * rates[s] * upwards[s] for s in places) / total
    vertical = 1.0 - gravity * t - momentum + momentum[0]
    height = integral(vertical)
    samples = {"time": t, "body_height": height, "body_vertical_velocity": vertical,
               **{f"{s}_position": q for s, q in places.items()}, **{f"{s}_velocity": v for s, v in rates.items()}}
    angle = np.abs(integral(integral(moment))).max() / scene["body.inertia"]
    known = angle * scene["body.wheelbase"] / 2.0 / height.max()
    assert validity_of(scene, samples).pitch_index == pytest.approx(known, rel=1e-3)


def test_masses_on_one_upright_line_through_the_centre_turn_nothing():
    assert validity(device(guide__angle=0.0), duration=2.0).pitch_index == 0.0


def test_no_index_without_a_hop_and_no_share_without_a_winding():
    assert validity(vibro_ros.load_scene("damped"), duration=0.5, rate=200.0) == (None, None)
    assert validity(device(motor__speed=0.0), duration=0.5, rate=200.0) == (None, None)
    assert validity(device(), duration=0.0, rate=200.0) == (None, None)


def test_a_flight_with_a_pause_or_of_an_unknown_begin_does_not_count():
    scene = device()
    run = {name: value for name, value in vars(vibro_ros.simulate(scene, duration=2.0, rate=200.0)).items()
           if isinstance(value, np.ndarray) and name != "events"}
    ground, top = np.flatnonzero(run["body_height"] == 0.0)[:5], run["body_height"].argmax()
    for rows in ([*ground, top], [top - 1, top, top + 1]):
        assert validity_of(scene, {name: value[rows] for name, value in run.items()}).pitch_index == 0.0


@pytest.mark.parametrize(("continuous", "warns"), [(2.2, False), (0.5, True)])
def test_the_rms_current_over_the_continuous_one(continuous, warns):
    scene = vibro_ros.load_scene("machine").with_parameters({"motor.continuous_current": continuous})
    current = np.array([1.0, -1.0, 1.0, 1.0])
    found_validity = validity_of(scene, {"motor_current": current, **dict.fromkeys(
        ("time", "body_height", "body_vertical_velocity", "upper_position", "upper_velocity", "inclined_position",
         "inclined_velocity"), np.zeros(4))})
    assert found_validity.current_share == pytest.approx(1.0 / continuous, rel=1e-15)
    assert ["overheats" in sentence for sentence in found_validity.warnings()] == [True] * warns


def test_a_pitch_index_above_its_limit_is_warned_of():
    assert not validity(device()).warnings()
    sentence, = validity(device(body__crank_offset=0.03)).warnings()
    assert "the pitch index 0.7 is above 0.2" in sentence and "body.inertia" in sentence
