"""Multiple shooting: its equations against dense least squares, its derivatives against differences, windows that jump.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import vibro_ros
from vibro_lab.identification.nuisances import Start
from vibro_lab.identification.recording import Channel, Recording
from vibro_lab.identification.shooting import TIGHT, Jacobian, Shooting
from vibro_lab.identification.unknowns import Unknowns
from vibro_lab.identification.windows import Pass, Windows, state_names
from vibro_ros.simulation.runs import simulate

RANDOM = np.random.default_rng(38)
NAMES = ("body_position", "body_velocity")
GAP = np.array([[0.0, 0.1], [0.1, 0.2], [0.2, 0.3], [0.5, 0.6], [0.6, 0.7]])  # s; the windows on both sides of 0.4 s
PARAMETERS = 3


def made(spans=GAP):
    """Return windows with the measurements of a body that rests, of standard deviation 1."""
    times = np.arange(0.005, spans[-1, 1], 0.01)
    channels = tuple(Channel("odom", name, times, np.zeros(len(times)), 1.0, "given") for name in NAMES)
    return Windows(Recording(0.0, times[-1], channels, (), ()), NAMES, spans)


def linear(windows, parameters=PARAMETERS):
    """Return a shooting through windows whose residuals and ends are linear, and the derivatives."""
    count, states, measurements = len(windows.spans), len(NAMES), len(windows.window)
    by = Jacobian(RANDOM.standard_normal((measurements, parameters)), RANDOM.standard_normal((measurements, states)),
                  1e-3 * RANDOM.standard_normal((count, states, parameters)),
                  RANDOM.standard_normal((count, states, states)))
    first, ends = RANDOM.standard_normal(measurements), 1e-3 * RANDOM.standard_normal((count, states))

    def simulated(coordinates, point):
        return Pass(first + by.residuals @ coordinates + np.sum(by.residuals_by_state * point[windows.window], axis=1),
                    ends + by.ends @ coordinates + np.einsum("kij,kj->ki", by.ends_by_state, point))

    return Shooting(windows, simulated), by


def dense(shooting, by, point, width):
    """Return matrix and right side of all residuals and defects, in units of their widths, for a dense solver."""
    windows, (count, states), parameters = shooting.windows, point.states.shape, len(point.parameters)
    rows, right = [], []
    for residual, window, by_parameters, by_state in zip(point.simulated.residuals, windows.window, by.residuals,
                                                         by.residuals_by_state, strict=True):
        row = np.zeros((count, states))
        row[window] = by_state
        rows.append([*by_parameters, *row.ravel()])
        right.append(residual)
    for k in np.flatnonzero(windows.joined):
        for i in range(states):
            row = np.zeros((count, states))
            row[k], row[k + 1, i] = by.ends_by_state[k, i], -1.0
            scale = 1.0 / (width * shooting.widths[i])
            rows.append([scale * derivative for derivative in (*by.ends[k, i], *row.ravel())])
            right.append(scale * (point.simulated.ends[k, i] - point.states[k + 1, i]))
    assert np.shape(rows)[1] == parameters + count * states
    return np.array(rows), np.array(right)


@pytest.fixture
def problem():
    """Return a linear shooting through windows with a gap, its derivatives and a point."""
    shooting, by = linear(made())
    return shooting, by, shooting.point(RANDOM.standard_normal(PARAMETERS), RANDOM.standard_normal((len(GAP), 2)))


def test_a_step_is_that_of_dense_least_squares(problem):
    """Equal to 1e-8 of the largest number: widths of 1 and 100 square to a condition of the equations of 1e5."""
    shooting, by, point = problem
    matrix, right = dense(shooting, by, point, 1.0)
    exact = -np.linalg.lstsq(matrix, right, rcond=None)[0]
    parameter_steps, state_steps = shooting.equations(point, by, 0.0, 1.0).step()
    assert_allclose(np.concatenate([parameter_steps, state_steps.ravel()]), exact, rtol=0,
                    atol=1e-8 * np.abs(exact).max())
    assert shooting.misfit(point, 0.0, 1.0) == pytest.approx(right @ right)


def test_the_information_is_that_of_parameters_when_the_states_are_unknown_as_well(problem):
    shooting, by, point = problem
    matrix, _ = dense(shooting, by, point, 1.0)
    covariance = np.linalg.inv(matrix.T @ matrix)[:PARAMETERS, :PARAMETERS]
    inverse = np.linalg.inv(shooting.equations(point, by, 0.0, 1.0).information())
    assert_allclose(inverse, covariance, rtol=1e-6, atol=1e-9 * np.abs(covariance).max())


def test_a_damped_step_is_the_dense_one_with_a_larger_diagonal(problem):
    shooting, by, point = problem
    matrix, right = dense(shooting, by, point, 1.0)
    square = matrix.T @ matrix
    exact = -np.linalg.solve(square + 0.5 * np.diag(np.diag(square)), matrix.T @ right)
    parameter_steps, state_steps = shooting.equations(point, by, 0.0, 1.0).step(0.5)
    assert_allclose(np.concatenate([parameter_steps, state_steps.ravel()]), exact, rtol=0,
                    atol=1e-8 * np.abs(exact).max())


def test_a_prior_counts_as_one_measurement_more_of_each_coordinate(problem):
    shooting, by, point = problem
    expected, weights = RANDOM.standard_normal(PARAMETERS), np.array([1.0, 4.0, 9.0])
    shooting.prior = expected, weights
    matrix, right = dense(shooting, by, point, 1.0)
    more = np.zeros((PARAMETERS, matrix.shape[1]))
    more[:, :PARAMETERS] = np.diag(np.sqrt(weights))
    exact = -np.linalg.lstsq(np.vstack([matrix, more]), np.concatenate(
        [right, np.sqrt(weights) * (point.parameters - expected)]), rcond=None)[0]
    assert_allclose(shooting.equations(point, by, 0.0, 1.0).step()[0], exact[:PARAMETERS], rtol=1e-7, atol=1e-9)


def test_a_parameter_that_is_held_moves_by_the_distance_and_the_rest_follows(problem):
    """With a coordinate held at a distance of 0.3, the rest is the dense solution without its column, to 1e-4."""
    shooting, by, point = problem
    matrix, right = dense(shooting, by, point, 1.0)
    exact = -np.linalg.lstsq(matrix[:, 1:], right - 0.3 * matrix[:, 0], rcond=None)[0]
    equations = shooting.equations(point, by, 0.0, 1.0)
    parameter_steps, state_steps = equations.held(np.eye(PARAMETERS)[0], 1e9, 0.3).step()
    assert parameter_steps[0] == pytest.approx(-0.3, abs=1e-4)
    assert_allclose(np.concatenate([parameter_steps[1:], state_steps.ravel()]), exact, rtol=0,
                    atol=1e-4 * np.abs(exact).max())
    assert_allclose(equations.states_for(parameter_steps),
                    shooting.equations(point, by, 0.0, 1.0).states_for(parameter_steps))


def test_the_minimum_of_a_linear_problem_is_found_and_its_derivatives_are_those_of_the_pass(problem):
    shooting, by, point = problem
    jacobian = shooting.jacobian(point)
    for name in ("residuals", "residuals_by_state", "ends", "ends_by_state"):
        assert_allclose(getattr(jacobian, name), getattr(by, name), rtol=0, atol=1e-6, err_msg=name)
    matrix, right = dense(shooting, by, point, 1.0)
    least = np.linalg.lstsq(matrix, right, rcond=None)[1][0]
    point = shooting.minimise(point, 0.0, 1.0, 20, 1e-9)
    assert shooting.misfit(point, 0.0, 1.0) == pytest.approx(least, abs=0.02)  # steps end when they win less than 0.01
    assert not shooting.left_out.any()


def test_the_misfit_of_a_window_has_its_residuals_and_the_defect_at_its_end(problem):
    shooting, _, point = problem
    misfits = shooting.by_window(point, 0.0, TIGHT)
    defects = np.sum((point.defects / (TIGHT * shooting.widths))**2, axis=1)
    for k, part in enumerate(shooting.windows.slices):
        joined = k in (0, 1, 3)  # there is a gap after the third window, and nothing after the last
        assert misfits[k] == pytest.approx(np.sum(point.simulated.residuals[part]**2) + (defects[k] if joined else 0.0))
    shooting.left_out[1] = True
    less = shooting.by_window(point, 0.0, TIGHT)
    assert less[1] == 0.0  # and neither defect of the window counts
    assert less[0] == pytest.approx(np.sum(point.simulated.residuals[shooting.windows.slices[0]]**2))
    assert_allclose(less[2:], misfits[2:])


def test_a_window_in_another_motion_does_not_tear_its_neighbours_where_samples_are_far_apart(problem):
    """Cauchy's function of a defect d of two numbers is 18 log(1 + d² / 18), its weight the derivative by d²."""
    shooting, _, point = problem
    squares = np.where(shooting.windows.joined, np.sum((point.defects / (0.1 * shooting.widths))**2, axis=1), 0.0)
    assert_allclose(shooting.joints(point.defects, 0.1)[0], squares)
    assert_allclose(shooting.joints(point.defects, 0.1)[1], shooting.windows.joined)
    plain = shooting.by_window(point, 0.0, 0.1)
    shooting.is_coarse = True
    rho, weight = shooting.joints(point.defects, 0.1)
    assert squares.max() > 1e4
    assert_allclose(rho, 18.0 * np.log1p(squares / 18.0))
    assert_allclose(weight, shooting.windows.joined / (1.0 + squares / 18.0))
    assert_allclose((plain - shooting.by_window(point, 0.0, 0.1))[:-1], squares - rho)


def test_a_window_torn_from_the_one_before_joins_it_again_and_the_misfit_falls(problem):
    """What the states of a torn window should have been is the end of the window before."""
    shooting, _, point = problem
    shooting.is_coarse = True
    point = shooting.minimise(point, 0.0, 0.1, 10)
    states = point.states.copy()
    states[1] += 1e4 * shooting.widths
    torn = shooting.point(point.parameters, states)
    joined = shooting.rejoined(torn, 0.0, 0.1)
    assert_allclose(joined.states[1], point.simulated.ends[0])
    assert_allclose(np.delete(joined.states, 1, axis=0), np.delete(point.states, 1, axis=0))
    trial = shooting.point(joined.parameters, joined.states)
    assert_allclose(joined.simulated.residuals, trial.simulated.residuals)
    assert_allclose(joined.simulated.ends, trial.simulated.ends)
    assert shooting.misfit(joined, 0.0, 0.1) < shooting.misfit(torn, 0.0, 0.1)


def test_a_loose_misfit_gives_an_outlier_little_weight(problem):
    """Cauchy's function of a residual r, blurred by b, is 9 log(1 + (r / b)² / 9); its weight is the derivative by r².
    """
    shooting, _, point = problem
    rho, weight = shooting.losses(point, 1.0)
    blur = 1.0 + (np.where(shooting.windows.channel == 0, 1e-3, 0.1))**2  # of position and speed; sigma is 1
    squares = point.simulated.residuals**2
    assert_allclose(rho, 9.0 * np.log1p(squares / blur / 9.0))
    assert_allclose(weight, 1.0 / (blur * (1.0 + squares / blur / 9.0)))
    assert_allclose(shooting.losses(point, 0.0)[0], squares)


def test_a_window_is_repaired_from_the_end_of_the_one_before_if_that_fits_better():
    """A body in uniform motion; the second window and the last begin elsewhere, the last after a gap."""
    windows = made(GAP[1:])

    def simulated(coordinates, states):
        since = windows.times - windows.spans[windows.window, 0]
        place = states[windows.window, 0] + states[windows.window, 1] * since
        speed = states[windows.window, 1]
        true = np.where(windows.channel == 0, 2.0 * windows.times, 2.0)
        span = windows.spans[:, 1] - windows.spans[:, 0]
        return Pass((np.where(windows.channel == 0, place, speed) - true) / 1e-3,
                    np.column_stack([states[:, 0] + states[:, 1] * span, states[:, 1]]))

    shooting = Shooting(windows, simulated)
    true = np.column_stack([2.0 * windows.spans[:, 0], np.full(4, 2.0)])
    wrong = true + [[0.0, 0.0], [0.1, 0.0], [10.0, 0.0], [0.0, 0.0]]
    repaired = shooting.repaired(shooting.point(np.zeros(1), wrong), 0.01, [])
    assert_allclose(repaired.states[[0, 1, 3]], true[[0, 1, 3]], atol=1e-12)
    assert_allclose(repaired.states[2], wrong[2])  # the end of the window before the gap is nearer, and no start
    repaired = shooting.repaired(repaired, 0.01, [true + [0.0, 1e-4]])
    assert_allclose(repaired.states[2], true[2] + [0.0, 1e-4], atol=1e-12)
    assert_allclose(repaired.states[[0, 1, 3]], true[[0, 1, 3]], atol=1e-12)  # what fits better already stays


def test_a_window_that_jumps_is_left_out_and_the_others_are_fitted():
    """The residuals of the third window grow by 100 wherever the parameter leaves its start: it spoils every step."""
    windows = made()
    shooting, by = linear(windows, 1)
    plain = shooting._simulate

    def simulated(coordinates, states):
        linear_pass = plain(coordinates, states)
        jump = np.where((windows.window == 2) & (abs(coordinates[0]) > 1e-4), 100.0, 0.0)
        return Pass(linear_pass.residuals + jump, linear_pass.ends)

    shooting = Shooting(windows, simulated)
    point = shooting.point(np.zeros(1), np.zeros((len(GAP), 2)))
    misfit_before = shooting.misfit(point, 0.0, 1.0)
    minimum = shooting.minimise(point, 0.0, 1.0, 10, enough=1e-6)
    assert shooting.left_out.tolist() == [False, False, True, False, False]
    assert shooting.misfit(minimum, 0.0, 1.0) < misfit_before
    used = windows.window != 2
    matrix, right = dense(shooting, by, point, 1.0)
    rows = np.append(used, np.repeat([True, False, True], 2))  # the defect before the window does not count either
    left = matrix[rows] @ np.linalg.lstsq(matrix[rows], right[rows], rcond=None)[0] - right[rows]
    assert shooting.misfit(minimum, 0.0, 1.0) == pytest.approx(float(left @ left), abs=2e-3)


def test_a_step_that_bends_the_joints_is_corrected_and_no_window_left_out_for_it():
    """Ends grow with the square of the parameter, of which the derivatives at 0 say nothing."""
    windows = made()

    def simulated(coordinates, point):
        return Pass(np.where(windows.channel == 0, coordinates[0] - 1.0, point[windows.window, 1]),
                    point + np.array([1e-5 * coordinates[0]**2, 0.0]))

    shooting = Shooting(windows, simulated)
    shooting.is_coarse = True
    point = shooting.minimise(shooting.point(np.zeros(1), np.zeros((len(GAP), 2))), 0.0, shooting.tight, 2)
    assert point.parameters[0] == pytest.approx(1.0, abs=1e-3)
    assert not shooting.left_out.any()
    assert_allclose(point.defects[windows.joined], 0.0, atol=1e-7)


def test_where_there_is_no_motion_the_other_side_gives_the_derivative_and_a_step_is_shorter():
    windows = made(GAP[:1])

    def simulated(coordinates, states):
        if coordinates[0] > 1.0:
            return None
        return Pass(np.where(windows.channel == 0, coordinates[0] - 3.0, states[0, 1]) + 0.0 * states[0, 0],
                    np.zeros_like(states))

    shooting = Shooting(windows, simulated)
    point = shooting.point(np.array([1.0]), np.zeros((1, 2)))
    assert_allclose(shooting.jacobian(point).residuals[:, 0], np.where(windows.channel == 0, 1.0, 0.0), atol=1e-9)
    assert shooting.point(np.array([1.1]), np.zeros((1, 2))) is None
    point = shooting.minimise(shooting.point(np.array([0.9]), np.zeros((1, 2))), 0.0, 1.0, 10)
    assert 0.9 < point.parameters[0] <= 1.0


@pytest.fixture(scope="module")
def robot():
    """Return a shooting through windows of the damped robot, without noise, and the true point."""
    scene = vibro_ros.load_scene("damped").with_parameters({"motor.speed": 100.0})
    times = np.arange(151) / 500.0
    run, names = simulate(scene, times=times), state_names(scene)
    channels = tuple(Channel("odom" if name.startswith("body") else "joint_states", name, times, getattr(run, name),
                             1e-3 if name.endswith("velocity") else 5e-5, "given") for name in names)
    spans = np.array([[0.0, 0.1], [0.1, 0.2], [0.2, 0.3001]])
    windows = Windows(Recording(0.0, times[-1], channels, (), ()), names, spans)
    unknowns = Unknowns.of(scene, ("ground.friction", "upper.gap", "guide.angle"), {})
    shooting = Shooting(windows, lambda coordinates, states: windows.simulate(
        unknowns.scene_of(coordinates), Start({}, {}), states))
    states = windows.course(scene, Start({}, {}))
    return shooting, shooting.point(unknowns.coordinates(scene.parameters), states)


def test_the_true_robot_from_the_true_states_has_neither_residuals_nor_defects(robot):
    """A window's start is the rounded state, so 1e-9 standard deviations and 1e-9 of a width, not 0."""
    shooting, point = robot
    assert np.abs(point.simulated.residuals).max() < 1e-6
    assert np.abs(point.defects / shooting.widths).max() < 1e-9
    assert shooting.misfit(point, 0.0, TIGHT) < 1e-6


def test_the_derivatives_of_a_robot_that_strikes_are_central_differences(robot):
    """Central differences have an error of second order, those of the Jacobian of first: 1 % of the largest."""
    shooting, point = robot
    jacobian, step = shooting.jacobian(point), 2e-6
    for k in range(len(point.parameters)):
        change = step * np.eye(len(point.parameters))[k]
        up, down = (shooting.point(point.parameters + sign * change, point.states).simulated for sign in (1.0, -1.0))
        for name, column in (("residuals", jacobian.residuals[:, k]), ("ends", jacobian.ends[..., k])):
            central = (getattr(up, name) - getattr(down, name)) / (2.0 * step)
            assert_allclose(column, central, rtol=0, atol=0.01 * np.abs(central).max(), err_msg=f"{name} by {k}")
            assert np.abs(central).max() > 0.0


def test_a_robot_without_masses_has_no_state_to_begin_with():
    """Its body stands, and its crank turns as it is commanded."""
    without = {"effects.upper_mass": False, "effects.inclined_mass": False}
    scene, times = vibro_ros.load_scene("damped").with_parameters(without), np.arange(101) / 500.0
    channel = Channel("joint_states", "crank_angle", times, simulate(scene, times=times).crank_angle, 1e-3, "given")
    recording, spans = Recording(0.0, times[-1], (channel,), (), ()), np.array([[0.0, 0.1], [0.1, 0.2001]])
    windows = Windows(recording, state_names(scene), spans)
    states = windows.course(scene, Start({}, {}))
    assert states.shape == (2, 0)
    assert np.abs(windows.simulate(scene, Start({}, {}), states).residuals).max() < 1e-6
