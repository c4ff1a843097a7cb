"""The settings of the fit, each with its unit and the reason for its value.

`pytest -m slow lab/test/identification/test_settings.py` halves and doubles each of them: verdict and values stand.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class FitSettings:
    """Settings of the fit. A looseness of 1 permits 1 mm and 0.1 m/s, see `shooting`."""

    # Stages: short arcs, half turns, then the chain of all windows.
    arc: float = 0.16  # turns of the crank in a short arc: no blow leaves it, although parameters are 30 % off
    half: float = 0.5  # turns in a window of the second stage: mostly one blow of each mass
    chain: float = 2.0  # turns in a window of the chain: longer ones lose blows, shorter ones cost more states
    samples: float = 5.0  # fewest samples of the slowest sensor in a window of the first stages, else speeds are open
    arc_loosenesses: tuple[float, ...] = (1.0, 0.3, 0.1)
    half_loosenesses: tuple[float, ...] = (0.3, 0.1)
    coarse_loosenesses: tuple[float, ...] = (1.0, 0.3, 0.1)  # of half turns that no short arc has prepared
    chain_loosenesses: tuple[float, ...] = (0.1, 0.01, 1e-3)  # 1e-3 is 1 µm, below all noise
    steps: int = 10  # most sets of derivatives at a looseness
    enough_of_parts: float = 0.05  # share of the misfit that a step must win: the looser, the less is a minimum worth
    enough_of_chain: float = 5e-3
    enough: float = 1e-5
    most_windows: int = 60  # in the first stages: a longer recording tells no better where to begin
    slowest: float = 20.0  # rad/s: a slower crank makes windows no longer
    repairs: int = 4  # rounds in which windows begin elsewhere: each may mend the window after a mended one
    draws: int = 20  # states tried at the start of a window that is lost where samples are too few to tell them
    drawn_widths: float = 5.0  # standard deviation of such a draw: 5 mm and 0.5 m/s, what a line through few is off
    weight: float = 1.0  # of the first stages' prior, in coordinates
    stiff_weight: float = 100.0  # of a plate's stiffness there, which shows only within a blow
    lost: float = 1.5  # mean square of a window's residuals beyond which it counts as lost
    most_lost: float = 0.3  # share of lost windows beyond which it is the model that does not fit

    # Masses that no sensor measures: an IMU feels their blows.
    unseen_loosenesses: tuple[float, ...] = (0.3, 0.1, 0.03, 0.01)
    tied: float = 0.1  # looseness of the defects over that of measurements: only the chain tells how such a mass moves
    blur: float = 0.01  # s, of an IMU at looseness 1: a tenth of the time between two blows
    least_blurred: float = 0.03  # least looseness at which an IMU is blurred
    unseen_weight: float = 30.0  # of the prior: steps stay where blows keep their order
    rounds: int = 6  # most rounds from the motion of the scene that was found
    few_lost: float = 0.1  # share of lost windows after which there is no further round
    far_off_in_shares: float = 0.1  # standard deviation of the first draws, of logarithms
    far_off: float = 0.2  # the same, of other coordinates
    scouts: tuple[float, ...] = (1.0, 0.5, 0.25)  # shares of them, one after the other
    drawn: int = 60  # robots drawn with each share
    better: float = 0.95  # largest share of the best misfit that a better one has: rounding must not choose

    # Where the recording begins, and what its noise is.
    presumed: float = 0.1  # looseness as large as which a noise is presumed that neighbours do not tell: 0.1 mm
    rate: float = 1000.0  # Hz, of simulated speeds where none are measured
    first: float = 0.02  # s at a start from which the crank's speed there is read: a motor gains 4 rad/s in it
    settled: float = 3.0  # standard deviations beyond which a correlation, a noise or a speed is taken as measured

    # Clocks and cameras.
    latest: float = 0.02  # s, largest offset of a sensor's stamps: beyond it a camera is a turn's third late
    scanned: int = 21  # offsets within it that are tried first: 2 ms apart, a fifth of a radian
    scouted: int = 15  # windows in which they are tried: enough to outvote those that a blow spoils
    clearly: float = 0.7  # share of the misfit at offset 0 that another one must reach
    retimed: float = 1e-4  # s, an offset from which windows are cut anew: 1 mm of the fastest mass
    drift: float = 1e-4  # deviation of a clock's rate: 100 ppm, of a cheap quartz
    drift_from: float = 3.0  # s of recording from which a rate is told: 100 ppm are 0.3 ms then
    jitter: float = 3e-4  # s on both sides of a stamp, over which the first slopes are taken: a blow's duration
    rounds_of_noise: int = 2  # of noise and fit in turn, where the noise is not as stated: a third changes nothing
    unexplained: float = 3.0  # mean square beside jitter and size beyond which it is the model that does not fit
    wild: float = 6.0  # standard deviations beyond which a measurement between good ones is an outlier
    most_wild: float = 0.06  # share of outliers of a channel beyond which they are none
