"""Estimate the speed over ground from an encoder and a clipped IMU: python examples/estimator.py

The accelerometer clips every blow, so its integral is not the speed, and the crank's speed says little about the speed
over ground. But the rest of the force over some turns, its means, its spreads and the share of clipped samples, depends
on how the robot moves. The estimator therefore learns from runs with known speed, as on a test bench, and is tested on
other runs. Each line has the true speed, too.
"""

import numpy as np

import vibro_ros

SENSORS = {"sensors.preset": "bmi270", "sensors.imu.rate": 800.0, "sensors.encoder.rate": 100.0}
WINDOW = 1.0  # s, some ten turns
LIMIT = 0.99 * 16.0 * 9.80665  # m/s², beyond which a sample counts as clipped
_UNITS = np.array([100.0, 5.0, 10.0, 50.0, 50.0, 0.01, 0.01])  # of the features


def features(measurements):
    """Return features of a window's measurements: numbers of magnitude 1, their squares and products; shape (36,)."""
    force = np.array([measurement.values[:3:2] for measurement in measurements  # along x and z
                      if measurement.sensor == "imu"])
    crank = np.mean([measurement.values[1] for measurement in measurements if measurement.sensor == "encoder"])
    values = np.array([1.0, *np.concatenate([[crank], force.mean(axis=0), force.std(axis=0),
                                             (abs(force) > LIMIT).mean(axis=0)]) / _UNITS])
    return np.outer(values, values)[np.triu_indices(len(values))]


def windows(seed):
    """Windows of a run at 16 random motor speeds: features, shape (16, 36), integral of the force, and speed [m/s]."""
    random = np.random.default_rng(seed)
    scene = vibro_ros.load_scene("device").with_parameters({**SENSORS, "sensors.seed": float(seed)})
    device, rows = vibro_ros.SensedSimulator(scene), []
    for _ in range(16):
        device.command(motor_speed=random.uniform(40.0, 150.0))
        device.advance_to(device.time + 1.5)  # until the motion is steady
        device.take_measurements()
        place = device.state.body_position
        device.advance_to(device.time + WINDOW)
        measurements = device.take_measurements()
        accelerations = [measurement.values[0] for measurement in measurements if measurement.sensor == "imu"]
        integral = np.mean(accelerations) * WINDOW
        rows.append((features(measurements), integral, (device.state.body_position - place) / WINDOW))
    return map(np.array, zip(*rows, strict=True))


def learned(seeds):
    """Weights of the features, by least squares with a little ridge, over the windows of several runs."""
    values, _, speeds = map(np.concatenate, zip(*(windows(seed) for seed in seeds), strict=True))
    return np.linalg.solve(values.T @ values + 1e-2 * np.eye(values.shape[1]), values.T @ speeds)


def main():
    """Learn, and print estimates beside the truth."""
    weights = learned(range(8))
    values, integral, speeds = map(np.concatenate, zip(*(windows(seed) for seed in range(100, 103)), strict=True))
    estimates = values @ weights
    for estimate, speed in list(zip(estimates, speeds, strict=True))[:5]:
        print(f"estimated {estimate * 1e3:6.1f} mm/s, truth {speed * 1e3:6.1f} mm/s")
    for name, estimated in (("mean speed", speeds.mean()), ("integral", integral), ("estimator", estimates)):
        print(f"{name:10}: rms error {np.sqrt(np.mean((estimated - speeds) ** 2)) * 1e3:.1f} mm/s")


if __name__ == "__main__":
    main()
