"""MuJoCo: the body on slide joints along x and y with a frictional contact, the masses on slide joints of their own.

Plain: its own soft contacts and limits with their default stiffness, which do not bounce; tuned: plates as forces that
the program computes at each step, friction as `frictionloss` of the joint x that follows mu N, and, where the body may
leave the ground, a contact as stiff as the step allows, with a damping ratio of 3, because with 1 the body bounces
where it should land. A body that should bounce has a contact that lasts longer than some ten steps, with the damping
ratio that gives the restitution. Where the equations leave out the reaction of the body on the masses (`reaction` is
false), the masses hang on the world and their forces act on the body.
"""

import math
from importlib.metadata import version as _version

import mujoco
import numpy as np
from scipy.optimize import brentq

from vibro_lab.accuracy.programs import PLAIN, TUNED, Answer, Setting

SETTINGS = (Setting(2e-3, "limits as they come, 2e-3 s", PLAIN), Setting(1e-4, "limits as they come, 1e-4 s", PLAIN),
            Setting(1e-5, "plates by forces, 1e-5 s", TUNED), Setting(1e-6, "plates by forces, 1e-6 s", TUNED))


def version():
    """Return MuJoCo's version."""
    return f"mujoco {_version('mujoco')}"


def _xml(p, setting):
    """Return the machine in MJCF, without the sliders, because their motion is given and they have no mass."""
    lean = f"{-math.sin(p['phi'])!r} 0 {math.cos(p['phi'])!r}"
    masses = ""
    for name, mass, axis, plate, stiff in (("u", p["m2"], "0 0 1", p["L2"] + p["gap2"], p["k4"]),
                                           ("w", p["m3"], lean, p["L3"] + p["gap3"], p["k1"])):
        limit = f'limited="true" range="-1 {plate!r}"' if setting.use == PLAIN and stiff else 'limited="false"'
        masses += (f'<body><joint name="{name}" type="slide" axis="{axis}" {limit}/><geom type="sphere" size="0.01" '
                   f'mass="{mass!r}" contype="0" conaffinity="0"/></body>') if mass else ""
    inside, outside = (masses, "") if p["reaction"] else ("", masses)
    loose = 0.0 if p["reaction"] else p["m2"] + p["m3"]
    contact = f'friction="{p["mu"]!r} 0 0" condim="{3 if setting.use == PLAIN else 1}" contype="1" conaffinity="1"'
    stiff, tuned = f'="{2.0 * setting.value!r} 1"', setting.use == TUNED
    lasts = 0.2 * math.sqrt(setting.value)
    law = _bounce(p["restitution"], lasts) if p["restitution"] else f"{2.0 * setting.value!r} 3"
    contact += f' solref="{law}" solimp="0.9999 0.9999 1e-6"' if tuned else ""
    friction = f'frictionloss="1e-9" solreffriction{stiff} solimpfriction="0.9999 0.9999 1e-6"' if tuned else ""
    upwards = '<joint name="y" type="slide" axis="0 0 1"/>' if setting.use == PLAIN or p["normal"] == "hop" else ""
    gravity = -p["g"] if p["weight"] else 0.0
    return f"""<mujoco><option timestep="{setting.value!r}" gravity="0 0 {gravity!r}"
      iterations="100" tolerance="1e-14"/>
      <worldbody><geom type="plane" size="10 10 1" {contact}/>{outside}
      <body pos="0 0 0.1"><joint name="x" type="slide" axis="1 0 0" {friction}/>{upwards}
      <geom type="sphere" size="0.1" mass="{p["m1"] + loose!r}" {contact}/>{inside}</body></worldbody></mujoco>"""


def _bounce(restitution, lasts):
    """Return stiffness and damping, in the form of `solref`, of a contact that `lasts` [s] and does not pull."""
    def rebound(ratio):
        root = math.sqrt(1.0 - ratio * ratio)
        return math.exp(-ratio / root * (math.pi - math.atan2(2.0 * ratio * root, 1.0 - 2.0 * ratio * ratio)))

    ratio, rate = brentq(lambda ratio: rebound(ratio) - restitution, 0.0, 0.99), math.pi / lasts
    return f"{-rate * rate!r} {-2.0 * ratio * rate!r}"


def _names(model):
    return {model.joint(k).name for k in range(model.njnt)}


def prepare(problem, setting):
    """Return a run that steps MuJoCo and applies the forces of the drives to the joints."""
    p = problem.parameters
    model = mujoco.MjModel.from_xml_string(_xml(p, setting))
    data = mujoco.MjData(model)
    joint = {name: model.joint(name).dofadr[0] for name in ("x", "y") if name in _names(model)}
    joint |= {name: model.joint(name).dofadr[0] for name, mass in (("u", p["m2"]), ("w", p["m3"])) if mass}
    guides = [(joint[name], angle, *(p[symbol] for symbol in symbols), p[rod] + p[gap])
              for name, angle, rod, gap, symbols in (
                  ("u", 0.0, "L2", "gap2", ("L2", "k2", "c2", "k4", "c4")),
                  ("w", p["phi"], "L3", "gap3", ("L3", "k3", "c3", "k1", "c1"))) if name in joint]
    x, y, total = joint["x"], joint.get("y"), sum(p[mass] for mass in ("m1", "m2", "m3"))
    by_forces, along = setting.use == TUNED, {joint.get("u"): (0.0, 1.0),
                                               joint.get("w"): (-math.sin(p["phi"]), math.cos(p["phi"]))}
    extra = 0.0 if p["weight"] else -total * p["g"]
    radius, omega, adhesion, reaction = p["l"], p["omega"], p["adhesion"], p["reaction"]
    pressed = p["normal"] != "weight"

    def apply():
        """Apply the forces along the joints; the body receives the opposite of each drive's force, along its guide."""
        t = data.time
        fx, fy = 0.0, extra
        for dof, angle, rod, k, c, stiff, damp, plate in guides:
            sine, cosine = math.sin(omega * t - angle), math.cos(omega * t - angle)
            root = math.sqrt(rod * rod - radius * radius * sine * sine)
            q, v = data.qpos[dof], data.qvel[dof]
            force = k * (q - radius * cosine - root) + c * (v + radius * sine * (1 + radius * cosine / root) * omega)
            if by_forces and stiff and q > plate:
                push = stiff * (q - plate) + damp * v
                force += push if adhesion else max(push, 0.0)
            data.qfrc_applied[dof] = -force
            if not reaction:
                force -= data.qfrc_constraint[dof]  # subtracts the joint limit's force of the previous step
                fx, fy = fx + force * along[dof][0], fy + force * along[dof][1] * pressed
        data.qfrc_applied[x] = fx
        if y is not None:
            data.qfrc_applied[y] = fy
        if by_forces:  # N from the given forces, or from the previous step
            normal = -fy if y is None else data.qfrc_constraint[y]
            model.dof_frictionloss[x] = p["mu"] * max(normal, 0.0)

    def run():
        mujoco.mj_resetData(model, data)
        for name in joint:
            data.qpos[joint[name]] = problem.start[name]
        rows = []
        for time in problem.times:
            while data.time < time - 0.5 * setting.value:
                apply()
                mujoco.mj_step(model, data)
            states = {name: (data.qpos[dof], data.qvel[dof]) for name, dof in joint.items()}
            rows.append([value for name in ("u", "w", "x", "y") for value in states.get(name, (0.0, 0.0))])
        return Answer(lambda: np.array(rows))

    return run
