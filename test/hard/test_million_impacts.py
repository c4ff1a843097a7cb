"""A million impacts without loss, and the energy is still that of the start.

The motor stands and nothing rubs or damps, so the mechanical energy is a constant of the motion: from 0.07 m away,
springs of 1e5 N/m throw the masses at plates that stand 0.01 m before their rest positions, again and again. The energy
is computed here, from samples, and sees what blows take, which the solver's accounts book and do not question.
"""

import math

import numpy as np
import pytest

import vibro_ros

SIDES = ("upper", "inclined")
PLATES = {"rigid": "restitution", "compliant": "compliant"}


def bouncing(plates, changes):
    """A device whose masses never come to rest."""
    return vibro_ros.Simulator(vibro_ros.load_scene("unilateral").with_parameters({
        "motor.speed": 0.0, "start.state": "zero", "effects.friction": "none", "solver.accounts": True,
        **{f"{side}.spring.stiffness": 1e5 for side in SIDES}, **{f"{side}.gap": -0.01 for side in SIDES},
        **{f"{side}.plate.restitution": 1.0 for side in SIDES},
        **{f"effects.{side}_contact": PLATES[plates] for side in SIDES}, **changes}))


def energy(scene, samples):
    """Kinetic energy and that of every spring [J], shape of the samples.

    As in the paper the body takes no energy from the masses, whose own is kept; with the reaction that of all is.
    """
    body = samples.body_velocity * float(scene["effects.reaction"])
    total = scene["mass.body"] * body**2 / 2
    for side, lean in (("upper", 0.0), ("inclined", math.sin(scene["guide.angle"]))):
        speed = getattr(samples, f"{side}_velocity")
        total += scene[f"mass.{side}"] * (speed**2 - 2 * lean * speed * body + body**2) / 2
        total += getattr(samples, f"{side}_drive_force") ** 2 / (2 * scene[f"{side}.spring.stiffness"])
        if scene[f"effects.{side}_contact"] == "compliant":
            total += getattr(samples, f"{side}_plate_force") ** 2 / (2 * scene[f"{side}.plate.stiffness"])
    return total


def bounce(device, impacts):
    """Energies [J] at the start and every 0.97 s, and events, until there have been so many impacts."""
    energies, events, met = [[energy(device.scene, device.state)]], [], 0
    while met < impacts:
        energies.append(energy(device.scene, device.sample(device.time + 0.97 * np.arange(1, 11))))
        events.append(device.take_events())
        met += len(events[-1])
        assert device.time < 2000.0, "they do not bounce all the time"
    return np.concatenate(energies), np.concatenate(events)


@pytest.mark.parametrize("reaction", [False, True])
@pytest.mark.parametrize("plates", PLATES)
def test_a_million_impacts_keep_the_energy(plates, reaction):
    """A31. To 1e-9 of the energy, which is 1e-15 an impact: rounding changes it by 2e-16 an impact, possibly always in
    the same direction.
    """
    device = bouncing(plates, {"effects.reaction": reaction})
    energies, events = bounce(device, 1_000_000)
    counts = [np.count_nonzero(events["kind"] == f"{side}_contact") for side in SIDES]
    assert sum(counts) == len(events) >= 1_000_000
    assert min(counts) > 400_000
    assert energies[0] > 500.0
    assert events["speed"].min() > 70.0
    np.testing.assert_allclose(energies, energies[0], rtol=1e-9, atol=0.0)
    # what segments gained, blows left out
    assert abs(device.statistics["energy_accounts"]["residual"]) <= 1e-9 * energies[0]


def test_energy_decreases_by_the_losses_of_the_blows():
    """The test of the energy detects a restitution of 0.9999: each blow dissipates (1 - e²) m v²/2, which the accounts
    add up.
    """
    device = bouncing("rigid", {f"{side}.plate.restitution": 0.9999 for side in SIDES})
    energies, events = bounce(device, 5000)
    mass = np.where(events["kind"] == "upper_contact", device.scene["mass.upper"], device.scene["mass.inclined"])
    taken = np.sum((1.0 - 0.9999**2) * mass * events["speed"] ** 2 / 2)
    assert taken > 0.1 * energies[0]
    assert energies[0] - energies[-1] == pytest.approx(taken, rel=1e-11)  # 1e4 roundings of 600 J
    assert abs(device.statistics["energy_accounts"]["residual"]) <= 1e-9 * energies[0]
