"""Follow a target with a tracking system that is late and drops out: python examples/feedback.py

The controller receives the robot's position a tenth of a second late, at most ten times a second, and sets the motor's
speed. Between measurements, and during dropouts, it extrapolates the position from the last measurement with the
measured speed.
"""

import vibro_ros

SENSORS = {"sensors.tracking.rate": 10.0, "sensors.tracking.latency": 0.1, "sensors.tracking.noise": 0.002,
           "sensors.tracking.dropout_probability": 0.05, "sensors.tracking.dropout_duration": 0.5}
PERIOD = 0.1  # s, of the controller
TARGET = -0.05  # m/s
RESTING, GAIN, FASTEST = 60.0, 2500.0, 105.0  # rad/s, rad/s a metre, rad/s; beyond the last the robot is slower again


class Controller:
    """A controller that receives only measurements and the time."""

    def __init__(self):
        self.time, self.place, self.speed = 0.0, 0.0, 0.0  # of the last measurement, and the speed over ground

    def motor_speed(self, now, measurements):
        """Motor speed [rad/s] to command at the time `now` [s]."""
        for _, time, values in measurements:
            if time > self.time:
                seen = (values[0] - self.place) / (time - self.time)
                self.speed += 0.3 * (seen - self.speed)
                self.time, self.place = time, values[0]
        ahead = self.place + self.speed * (now - self.time) - TARGET * now  # m; the robot crawls to -x
        return min(max(RESTING + GAIN * ahead, 0.0), FASTEST)


def errors(controller, duration=30.0, seed=0.0):
    """True distances [m] from the target at the end of each period; and how many measurements there were."""
    scene = vibro_ros.load_scene("device").with_parameters({**SENSORS, "sensors.seed": seed})
    device, distances, count = vibro_ros.SensedSimulator(scene), [], 0
    for k in range(round(duration / PERIOD)):
        measurements = device.take_measurements()
        count += len(measurements)
        device.command(motor_speed=controller.motor_speed(k * PERIOD, measurements))
        device.advance_to((k + 1) * PERIOD)
        distances.append(device.state.body_position - TARGET * device.time)
    return distances, count


if __name__ == "__main__":
    distances, count = errors(Controller())
    print(f"{count} of 300 measurements came; from 5 s on at most {max(map(abs, distances[50:])) * 1e3:.1f} mm from "
          f"the target, which went {abs(TARGET) * 30.0:.1f} m")
