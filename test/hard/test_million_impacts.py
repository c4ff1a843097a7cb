"""A million impacts without loss, and the energy still balances."""

import vibro_ros


def test_energy_balances_after_a_million_impacts():
    """Rigid plates with e = 1 on which stiff springs press the masses three quarters of each turn: they bounce all the
    time, and lose nothing. Asked for are 1e-9 of the energy exchanged; a million roundings of 5 J would be 1e-9 J."""
    device = vibro_ros.Simulator(vibro_ros.load_scene("rigid").with_parameters({
        "upper.plate.restitution": 1.0, "inclined.plate.restitution": 1.0, "upper.gap": -0.01, "inclined.gap": -0.01,
        "upper.spring.stiffness": 1e5, "inclined.spring.stiffness": 1e5, "effects.friction": "none",
        "motor.speed": 20.0, "solver.audit": True}))
    impacts = 0
    while impacts < 1_000_000:
        device.advance_to(device.time + 5.0)
        impacts = sum(device.statistics[f"{side}_contact"] for side in ("upper", "inclined"))
        assert device.time < 1000.0, f"{impacts} impacts only"
        device.take_events()
    statistics = device.statistics
    assert statistics["energy_exchanged"] > 1e4
    assert abs(statistics["energy_residual"]) <= 1e-9 * statistics["energy_exchanged"]
