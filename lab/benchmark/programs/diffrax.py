"""diffrax: explicit Runge-Kutta under JAX, compiled by XLA, in double precision.

Plain: one call, friction smoothed over 1e-3 m/s, as its examples smooth a force that jumps. Tuned: from event to event
by `diffrax.Event`, whose condition is the lowest guard of `benchmark.equations`, found by bisection on the dense
output; the mode is an argument of the compiled call, so that nothing is called back from Python within it.
"""

from importlib.metadata import version as _version

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix

from benchmark import located
from benchmark.equations import AIR, BACKWARD, FORWARD, FREE, STICK, Callbacks, machine, start
from vibro_lab.accuracy.programs import PLAIN, TUNED, Answer, Setting, UnableError

jax.config.update("jax_enable_x64", True)
SETTINGS = (*(Setting(rtol, f"Tsit5, rtol {rtol:g}", PLAIN) for rtol in (1e-3, 1e-6)),
            *(Setting(rtol, f"Dopri8 with events, rtol {rtol:g}", TUNED) for rtol in (1e-6, 1e-9, 1e-12)))
_WIDTH = 1e-3  # m/s, width over which a first script would smooth friction
_FIRST_STEP = 1e-6  # s
_ABOVE = 1e-300  # m, m/s: start value of a flight or a slip, because a condition that starts at zero cannot cross zero
_MOST_STEPS = 10**6


def version():
    """Return the versions of diffrax and of JAX."""
    return f"diffrax {_version('diffrax')} with jax {_version('jax')}"


def prepare(problem, setting):
    """Return a run by compiled calls of `diffeqsolve`: one for the whole run, or one from each event to the next.
    """
    if setting.use == PLAIN and problem.parameters["normal"] == "hop":
        raise UnableError("a landing is a jump, and without events no speed can jump")
    numbers = machine(problem, slow=setting.value)
    run = (_plain if setting.use == PLAIN else _from_event_to_event)(problem, numbers, setting.value)
    run()  # compiles
    return run


def _plain(problem, p, rtol):
    first, times = jnp.array(start(problem)), jnp.array(problem.times)

    def slope(t, y, args):
        upper, inclined = (_touches(p, q, v, *plate) for q, v, plate in (
            (y[0], y[1], (p.plate2, p.k4, p.c4)), (y[2], y[3], (p.plate3, p.k1, p.c1))))
        f2, f3 = _forces(p, t, y, upper, inclined)
        normal, rates = _rates(p, y, f2, f3, jnp.tanh(y[5] / _WIDTH), 0)
        return jnp.where((normal < 0.0) & (p.rule != 0), _rates(p, y, f2, f3, 0.0, FREE)[1], rates)

    @jax.jit
    def solve(y):
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(slope), diffrax.Tsit5(), 0.0, times[-1], _FIRST_STEP, y, saveat=diffrax.SaveAt(ts=times),
            throw=False, stepsize_controller=_control(rtol), max_steps=_MOST_STEPS)
        return solution.ys, solution.result == diffrax.RESULTS.successful

    def run():
        states, success = solve(first)
        if not success:
            raise UnableError(f"more than {_MOST_STEPS:g} steps")
        return Answer(np.asarray(states))

    return run


def _from_event_to_event(problem, p, rtol):
    callbacks, grid = Callbacks(p), jnp.array(problem.times)

    def slope(t, y, mode):
        f2, f3 = _forces(p, t, y, mode[0] != 0, mode[1] != 0)
        return _rates(p, y, f2, f3, mode[2].astype(float), mode[2])[1]

    event = diffrax.Event(lambda t, y, args, **_: jnp.min(jnp.stack(_guards(p, t, y, args))),
                          optimistix.Bisection(rtol=1e-15, atol=1e-15), direction=False)

    @jax.jit
    def solve(t, y, first_step, mode):
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(slope), diffrax.Dopri8(), t, grid[-1], first_step, y, mode, throw=False, event=event,
            saveat=diffrax.SaveAt(ts=jnp.maximum(grid, t), t1=True), max_steps=_MOST_STEPS,
            stepsize_controller=_control(rtol))
        good = (solution.result == diffrax.RESULTS.successful) | (solution.result == diffrax.RESULTS.event_occurred)
        return solution.ts, solution.ys, solution.result == diffrax.RESULTS.event_occurred, good

    def integrate(t, y, end, brief):
        ground, bounds = callbacks.mode[2], np.empty(4)
        if ground == AIR and y[6] == 0.0:
            y[6] = _ABOVE
        elif ground in (FORWARD, BACKWARD) and y[5] == 0.0:
            y[5] = ground * _ABOVE
        times, states, stopped, good = map(np.asarray, solve(t, y, min(_FIRST_STEP, brief), callbacks.mode[:3].copy()))
        if not good:
            raise UnableError(f"no end of steps or no root after {t:.6g} s")
        times = times[np.isfinite(times)]  # instants after the event are infinite
        rows, now = dict(zip(times.tolist(), states, strict=False)), times[-1]
        callbacks.guards(now, rows[now], bounds)
        yield now, lambda time: rows[time], int(bounds.argmin()) if stopped else None

    def run():
        answer = located.run(problem, callbacks, integrate)
        answer.callbacks = None  # no function of Python is called back within the compiled call
        return answer

    return run


def _control(rtol):
    return diffrax.PIDController(rtol=rtol, atol=1e-3 * rtol)


def _touches(p, position, speed, plate, stiff, damp):
    """Whether a plate pushes the mass."""
    return (position > plate) & (p.adhesion | (stiff * (position - plate) + damp * speed > 0.0))


def _forces(p, t, y, upper, inclined):
    """F2 and F3 of `benchmark.equations` [N]."""
    def guide_force(q, v, sine, cosine, rod, k, c, plate, stiff, damp, closed):
        ct, st = jnp.cos(p.omega * t), jnp.sin(p.omega * t)
        ca, sa = ct * cosine + st * sine, st * cosine - ct * sine
        root = jnp.sqrt(rod * rod - p.radius * p.radius * sa * sa)
        drive = k * (q - p.radius * ca - root) + c * (v + p.radius * sa * (1.0 + p.radius * ca / root) * p.omega)
        return drive if np.isinf(plate) else drive + jnp.where(closed, stiff * (q - plate) + damp * v, 0.0)

    return (guide_force(y[0], y[1], 0.0, 1.0, p.L2, p.k2, p.c2, p.plate2, p.k4, p.c4, upper)
            + p.m2 * p.heavy if p.m2 else 0.0,
            guide_force(y[2], y[3], p.sine, p.cosine, p.L3, p.k3, p.c3, p.plate3, p.k1, p.c1, inclined)
            + p.m3 * p.heavy * p.cosine if p.m3 else 0.0)


def _rates(p, y, f2, f3, slide, ground):
    """Return N and the derivative of the state, as `benchmark.equations.accelerations`: all cases are computed, and the
    one of `ground` is selected.
    """
    inward, weight, reacting_mass = -f3 * p.sine, p.total * p.g, p.reaction * p.m3
    air, stick = ground == AIR, ground == STICK
    pressed = jnp.where(air | (p.rule != 0), weight - f2 - f3 * p.cosine, weight)
    up = p.cosine if p.rule else 0.0
    along, across = p.total - reacting_mass * p.sine * p.sine, reacting_mass * p.sine * p.cosine
    high = p.total - p.reaction * p.m2 - reacting_mass * p.cosine * p.cosine
    scale, rub = 1.0 / (along * high - across * across), p.mu * slide
    on_ground = (inward - rub * pressed) / (p.total - reacting_mass * p.sine * (p.sine - rub * up))
    ax = jnp.where(air, scale * (high * inward + across * pressed), jnp.where(stick, 0.0, on_ground))
    ay = jnp.where(air, -scale * (along * pressed + across * inward), 0.0)
    au = -f2 / p.m2 - p.reaction * ay if p.m2 else 0.0
    aw = -f3 / p.m3 + p.reaction * (p.sine * ax - p.cosine * ay) if p.m3 else 0.0
    return jnp.where(air, 0.0, pressed + reacting_mass * p.sine * up * ax), jnp.stack(
        [jnp.asarray(value, float) for value in (y[1], au, y[3], aw, y[5], ax, y[7], ay)])


def _guards(p, t, y, mode):
    """Return four numbers that are positive within the mode, as `benchmark.equations.guards`.

    Forces are scaled down, because the bisection ends when both time and guard change by less than its tolerance.
    """
    values, ground, small = [], mode[2], 1e-7
    for q, v, plate, stiff, damp, closed in ((y[0], y[1], p.plate2, p.k4, p.c4, mode[0]),
                                             (y[2], y[3], p.plate3, p.k1, p.c1, mode[1])):
        depth = q - plate
        inside = depth if p.adhesion else jnp.minimum(depth, (stiff * depth + damp * v) / max(stiff, 1.0))
        values.append(jnp.asarray(1.0) if np.isinf(plate) else jnp.where(closed != 0, inside, -inside))
    f2, f3 = _forces(p, t, y, mode[0] != 0, mode[1] != 0)
    normal = _rates(p, y, f2, f3, jnp.where(ground == STICK, 0.0, ground.astype(float)), ground)[0]
    free = -small * normal if p.mu > 0.0 and p.rule else 1.0
    cases = [ground == AIR, ground == STICK, ground == FREE]
    values.append(jnp.select(cases, [y[6], small * (p.mu * normal + f3 * p.sine), 1.0], ground * y[5]))
    values.append(jnp.select(cases, [1.0, small * (p.mu * normal - f3 * p.sine), free],
                            small * normal if p.rule else 1.0))
    return values
