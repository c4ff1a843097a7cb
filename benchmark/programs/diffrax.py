"""diffrax: explicit Runge-Kutta under JAX, compiled by XLA, in double precision.

Its events end a run; a run from event to event is one call each. Plain and tuned smooth the friction over a width, as
its examples smooth a force that jumps; tuned narrows it and steps with `jump_ts` unknown at high order.
"""

from importlib.metadata import version as _version

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from benchmark.equations import machine, start
from vibro_ros.accuracy.programs import PLAIN, TUNED, Answer, Setting, UnableError

jax.config.update("jax_enable_x64", True)
SETTINGS = (Setting(1e-3, "Tsit5, rtol 1e-3, width 1e-3 m/s", PLAIN), 
            Setting(1e-6, "Tsit5, rtol 1e-6, width 1e-3 m/s", PLAIN),
            Setting(1e-8, "Dopri8, rtol 1e-8, width 1e-5 m/s", TUNED),
            Setting(1e-10, "Dopri8, rtol 1e-10, width 1e-6 m/s", TUNED))
_WIDTHS = {1e-3: 1e-3, 1e-6: 1e-3, 1e-8: 1e-5, 1e-10: 1e-6}  # m/s, by tolerance


def version():
    """Of the package and of JAX."""
    return f"diffrax {_version('diffrax')} with jax {_version('jax')}"


def prepare(problem, setting):
    """One compiled call of `diffeqsolve`."""
    if problem.parameters["normal"] == "hop":
        raise UnableError("a landing is a jump, and without events no speed can jump")
    p, first, times = machine(problem), jnp.array(start(problem)), jnp.array(problem.times)
    slope = _slope(p, _WIDTHS[setting.value])
    solver = diffrax.Tsit5() if setting.use == PLAIN else diffrax.Dopri8()

    @jax.jit
    def solve(y):
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(slope), solver, 0.0, times[-1], 1e-6, y, saveat=diffrax.SaveAt(ts=times), throw=False,
            stepsize_controller=diffrax.PIDController(rtol=setting.value, atol=1e-3 * setting.value), max_steps=10**6)
        return found.ys, found.result == diffrax.RESULTS.successful

    def run():
        states, success = solve(first)
        if not success:
            raise UnableError("more than 1e6 steps")
        return Answer(np.asarray(states))

    run()
    return run


def _slope(p, width):
    """The equations in JAX."""
    has_2, has_3 = p.m2 > 0.0, p.m3 > 0.0
    up, own = (p.cosine if p.rule else 0.0), p.reaction * p.m3

    def force(t, q, v, sine, cosine, rod, k, c, plate, stiff, damp):
        ct, st = jnp.cos(p.omega * t), jnp.sin(p.omega * t)
        ca, sa = ct * cosine + st * sine, st * cosine - ct * sine
        root = jnp.sqrt(rod * rod - p.radius * p.radius * sa * sa)
        drive = k * (q - p.radius * ca - root) + c * (v + p.radius * sa * (1.0 + p.radius * ca / root) * p.omega)
        if np.isinf(plate):
            return drive
        push = stiff * (q - plate) + damp * v
        return drive + jnp.where(q > plate, push if p.adhesion else jnp.maximum(push, 0.0), 0.0)

    def slope(t, y, args):
        f2 = force(t, y[0], y[1], 0.0, 1.0, p.L2, p.k2, p.c2, p.plate2, p.k4, p.c4) + p.m2 * p.heavy if has_2 else 0.0
        f3 = (force(t, y[2], y[3], p.sine, p.cosine, p.L3, p.k3, p.c3, p.plate3, p.k1, p.c1)
              + p.m3 * p.heavy * p.cosine) if has_3 else 0.0
        pressed = p.total * p.g - (f2 + f3 * p.cosine if p.rule else 0.0)
        rub = p.mu * jnp.tanh(y[5] / width)

        def along(rub):
            return (-f3 * p.sine - rub * pressed) / (p.total - own * p.sine * (p.sine - rub * up))

        ax = along(rub)
        if p.rule:
            ax = jnp.where(pressed + own * p.sine * up * ax < 0.0, along(0.0), ax)
        au = -f2 / p.m2 if has_2 else 0.0
        aw = -f3 / p.m3 + p.reaction * p.sine * ax if has_3 else 0.0
        return jnp.stack([jnp.asarray(value, float) for value in (y[1], au, y[3], aw, y[5], ax, 0.0, 0.0)])

    return slope
