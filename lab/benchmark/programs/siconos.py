"""Siconos: Moreau and Jean's time stepping; the ground is a unilateral contact with Coulomb friction, solved exactly.

Springs and plates are forces evaluated at the start of the step, as in Siconos' examples of state-dependent forces;
rigid plates would be another problem. theta is 1, with which the scheme is symplectic. Where the equations hold the
body down (`weight`, `unilateral`), its height is put back after each step, so that the impulse of a step is max(N, 0)
times the step. Plain: 1e-4 s; tuned: finer.
"""

import math
import subprocess

import numpy as np
import siconos
import siconos.kernel as sk

from vibro_lab.accuracy.programs import PLAIN, TUNED, Answer, Setting, UnableError

SETTINGS = (Setting(1e-4, "Moreau-Jean, 1e-4 s", PLAIN), Setting(1e-5, "Moreau-Jean, 1e-5 s", TUNED),
            Setting(1e-6, "Moreau-Jean, 1e-6 s", TUNED))


_DEPTH = -1e-12  # m, height of a body that is held down, because at 0 a rounding error could open its contact


def version():
    """Return the version that the program reports, and the one that Debian reports for its package: 4.5.0 and 4.4.0 for
    the same files.
    """
    package = subprocess.run(["dpkg-query", "--show", "--showformat=${Version}", "python3-siconos"], check=False,
                             capture_output=True, text=True).stdout
    return f"siconos {siconos.version}" + (f" (Debian's package {package})" if package else "")


def prepare(problem, setting):
    """Return a run by `TimeStepping`."""
    p = problem.parameters
    if not p["mu"] and not p["restitution"]:
        raise UnableError("without friction or bounces there is no law for its solver: only forces would be integrated")
    ex, ey = -math.sin(p["phi"]), math.cos(p["phi"])
    masses = [p["m2"] or 1.0, p["m3"] or 1.0]
    total = p["m1"] + p["m2"] + p["m3"]
    felt = [p["reaction"] * p["m2"], p["reaction"] * p["m3"] * ex, p["reaction"] * p["m3"] * ey]
    rows = np.array([[total, 0.0, 0.0, felt[1]], [0.0, total, felt[0], felt[2]],
                     [0.0, felt[0], masses[0], 0.0], [felt[1], felt[2], 0.0, masses[1]]])
    upper, inclined = (("L2", "k2", "c2", "k4", "c4"), ("L3", "k3", "c3", "k1", "c1"))
    guides = [(p[mass], angle, *(p[symbol] for symbol in symbols), p[symbols[0]] + p[gap],
               p[mass] * p["weight"] * share)
              for mass, angle, gap, symbols, share in (("m2", 0.0, "gap2", upper, p["g"]),
                                                       ("m3", p["phi"], "gap3", inclined, p["g"] * ey))]
    held, step = p["normal"] != "hop", setting.value
    lift = 0.0 if p["normal"] == "weight" or p["reaction"] else 1.0
    if p["normal"] == "weight":
        rows[1, 2:] = rows[2:, 1] = 0.0
    push = 0.0 if p["reaction"] else 1.0

    def forces(t, q, v):
        applied = [0.0, -total * p["g"], 0.0, 0.0]
        for k, (mass, angle, rod, spring, damper, stiff, damp, plate, weight) in enumerate(guides):
            if not mass:
                continue
            sine, cosine = math.sin(p["omega"] * t - angle), math.cos(p["omega"] * t - angle)
            root = math.sqrt(rod * rod - p["l"] ** 2 * sine * sine)
            speed = -p["l"] * sine * (1.0 + p["l"] * cosine / root) * p["omega"]
            force = spring * (q[2 + k] - p["l"] * cosine - root) + damper * (v[2 + k] - speed)
            if stiff and q[2 + k] > plate:
                contact = stiff * (q[2 + k] - plate) + damp * v[2 + k]
                force += contact if p["adhesion"] else max(contact, 0.0)
            applied[2 + k] = -force - weight
            applied[0] += push * force * (0.0, ex)[k]
            applied[1] += lift * force * (1.0, ey)[k]
        return applied

    def run():
        q = [problem.start[c] for c in ("x", "y", "u", "w")]
        body = sk.LagrangianDS(q, [problem.start[c] for c in ("dx", "dy", "du", "dw")], rows)
        body.setFExtPtr(forces(0.0, q, [0.0] * 4))
        law = sk.NewtonImpactFrictionNSL(p["restitution"], 0.0, p["mu"], 2)
        contact = sk.Interaction(law, sk.LagrangianLinearTIR(np.array([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])))
        model = sk.NonSmoothDynamicalSystem(0.0, problem.times[-1])
        model.insertDynamicalSystem(body)
        model.link(contact, body)
        stepping = sk.TimeStepping(model, sk.TimeDiscretisation(0.0, step), sk.MoreauJeanOSI(1.0),
                                   sk.FrictionContact(2))
        samples, done = [[problem.start[c] for c in ("u", "du", "w", "dw", "x", "dx", "y", "dy")]], 0
        for time in problem.times[1:]:
            while done < round(time / step):
                q, v = body.q(), body.velocity()
                body.setFExtPtr(forces(done * step, q, v))
                stepping.computeOneStep()
                if held:
                    body.q()[1], body.velocity()[1] = _DEPTH, 0.0
                stepping.nextStep()
                done += 1
            q, v = body.q(), body.velocity()
            samples.append([q[2], v[2], q[3], v[3], q[0], v[0], q[1], v[1]])
        return Answer(lambda: np.array(samples))

    return run
