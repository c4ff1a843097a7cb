"""The settings of the online estimator: what each one means, its unit, and why it has this value.

The values were chosen on the robots of `lab/test/twin/following.py`; `python lab/test/twin/following.py settings`
halves and doubles each of them and prints which of the twin's verdicts change.
"""

from dataclasses import dataclass

STEP = 0.05
"""Duration of a step of the filter [s]."""


@dataclass(frozen=True)
class FilterSettings:
    """The tuned numbers of the filter, in SI units."""

    # What a command and a measurement are worth
    latency: float = 0.0025  # s; mean time from a command's arrival to its effect: half a tick of a robot at 200 Hz
    lateness: float = 0.05  # s; standard deviation of that time: a busy machine delivers a message late now and then
    most_measured: int = 5  # of a quantity in a step; each instant costs all particles some microseconds
    tail: float = 4.0  # degrees of freedom of the Student distribution of errors
    acceleration_error: float = 0.6  # m/s²; what even the best particle lacks, besides the errors of the sensor
    crank_error: float = 1e-3  # rad; the same for the angle of the crank
    motor_speed_error: float = 0.5  # rad/s

    # Random walks of what the sensors' readings differ by from what the simulations say, in a second
    place_walk: float = 0.003  # m; the mean speed of a particle has errors
    bias_walk: float = 1e-3  # m/s²; of an IMU
    crank_walk: float = 1e-4  # rad; of a motor with a commanded speed
    loaded_crank_walk: float = 1e-2  # rad; of a dc motor, whose crank does not turn evenly
    least_turn: float = 1e-3  # rad; smallest correction of a crank's angle: each one begins a segment, and costs time

    # Weights, and copies of likely particles
    in_use: float = 0.4  # share of effective particles that tempering leaves
    resampled: float = 0.9  # share of effective particles below which they are resampled
    forgetting: float = 0.05  # share by which the logarithms of a copy's parameters are drawn to their mean
    pull: float = 0.05  # share by which that mean is drawn to what was believed: copies would soon share wrong ones
    place_scatter: float = 1.5e-6  # m; noise of the masses' places in each copy: a chaotic robot makes of more
    speed_scatter: float = 1.5e-4  # m/s; an error that no measurement takes back
    state_scatter: float = 0.1  # share of the particles' own deviation that is added to that noise

    # The start
    unlike_speed: float = 5.0  # rad/s; difference from which the encoder's speed is adopted
    unlike_angle: float = 0.1  # rad; difference from which the encoder's angle is adopted
    first_speed: float = 0.5  # s; the speed is then measured again over this time: at first the encoder is coarse

    # What is published
    least_place_deviation: float = 1e-4  # m; no estimate claims to be better, whatever the particles agree on
    least_speed_deviation: float = 3e-4  # m/s
    growth_memory: float = 1.0  # s; over which the innovations are averaged that let the speed's variance grow

    # When a robot has left the model, and which fault it has
    unusual: float = 4.0  # mean normalised square of innovations that is unusual when four times the usual one is added
    memory: float = 3.0  # s; over which the usual square is found
    most_usual: float = 25.0  # largest square that counts for it
    settling: float = 1.0  # s after a start in which nothing counts as unusual
    unexplained: float = 0.6  # s after which a departure without a name is reported
    given_up: float = 3.0  # s after which the filter starts again
    recent_begin: int = 4  # steps before now at which a fault may have begun that shows at once,
    early_begin: int = 10  # and at which one that shows slowly
    most_kept: int = 20  # steps that are kept for replays: a stuck plate shows so long after its command
    replayed: int = 4  # particles whose states are kept for replays
    check_period: float = 0.2  # s; least time between two comparisons of faults, each of which costs some tenths
    replayed_phase: float = 0.03  # rad; least deviation of a crank's angle in replays, which do not correct it
    named: float = 15.0  # log ratio of likelihoods from which a fault is named: many a fault is likelier than a lost
    margin: float = 5.0  # chaotic robot without one; and by how much it must exceed every other fault
    repeated: int = 5  # least number of equal values by which a sensor may have frozen
