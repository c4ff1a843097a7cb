"""Drake: a `LeafSystem` in Python whose one witness function is the lowest guard, under `Simulator`.

Its default integrator is RK3 with error control; the accuracy of the context also isolates the witnesses. Plain: the
accuracy is 1e-4; tuned: finer, with a longest step, and the bounces end where a flight would be shorter. MultibodyPlant
is not used, because its contact is compliant in a way of its own and its Coulomb friction is regularised.
"""

from importlib.metadata import version as _version

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem, UnrestrictedUpdateEvent, WitnessFunctionDirection

from benchmark.equations import AIR, BACKWARD, FORWARD, Callbacks, machine, start
from vibro_lab.accuracy.programs import PLAIN, TUNED, Answer, Setting, UnableError

SETTINGS = (Setting(1e-4, "RK3, accuracy 1e-4", PLAIN), Setting(1e-6, "RK3, accuracy 1e-6", TUNED),
            Setting(1e-8, "RK3, accuracy 1e-8", TUNED))
_LONGEST = 1e-3  # s, longest step, because a witness that changes its sign twice within a step is missed
_ABOVE = 1e-300  # m, m/s: start value of a flight or a slip, because a witness that starts at zero is not triggered
_MOST_EVENTS = 5000


def version():
    """Return Drake's version."""
    return f"drake {_version('drake')}"


class _Machine(LeafSystem):
    """The system with its eight states. The mode is not a state of the system: it is in `callbacks`, from which the
    equations read it.
    """

    def __init__(self, callbacks):
        super().__init__()
        self.callbacks, self.rate, self.bounds, self.events = callbacks, np.empty(8), np.empty(4), 0
        self.DeclareContinuousState(8)
        self.witnesses = [self.MakeWitnessFunction(
            "lowest guard", WitnessFunctionDirection.kPositiveThenNonPositive, self.lowest_guard,
            UnrestrictedUpdateEvent(self.cross))]

    def DoCalcTimeDerivatives(self, context, derivatives):  # noqa: N802 (Drake's name)
        self.callbacks.slope(context.get_time(), context.get_continuous_state_vector().CopyToVector(), self.rate)
        derivatives.get_mutable_vector().SetFromVector(self.rate)

    def DoGetWitnessFunctions(self, context):  # noqa: N802
        return self.witnesses

    def lowest_guard(self, context):
        self.callbacks.guards(context.get_time(), context.get_continuous_state_vector().CopyToVector(), self.bounds)
        return self.bounds.min()

    def cross(self, context, event, state):
        """Cross each guard that has become zero, the lowest first, and keep the guards of the next mode from starting
        at zero.
        """
        t, y = context.get_time(), context.get_continuous_state_vector().CopyToVector()
        while self.events < _MOST_EVENTS:
            self.events += 1
            self.callbacks.guards(t, y, self.bounds)
            which = int(self.bounds.argmin())
            self.callbacks.cross(t, y, which)
            ground = self.callbacks.mode[2]
            if ground == AIR and y[6] == 0.0:
                y[6] = _ABOVE
            elif ground in (FORWARD, BACKWARD) and y[5] == 0.0:
                y[5] = ground * _ABOVE
            self.callbacks.guards(t, y, self.bounds)
            if self.bounds.min() >= 0.0:
                break
        else:
            raise UnableError(f"events without end at {t:.6g} s")
        state.get_mutable_continuous_state().get_mutable_vector().SetFromVector(y)


def prepare(problem, setting):
    """Return a run of one `Simulator` that stops at the sampled instants."""
    callbacks = Callbacks(machine(problem, slow=problem.parameters["g"] * _LONGEST if setting.use == TUNED else 0.0))
    system = _Machine(callbacks)
    simulator = Simulator(system)
    integrator = simulator.get_mutable_integrator()
    integrator.set_target_accuracy(setting.value)
    simulator.get_mutable_context().SetAccuracy(setting.value)
    if setting.use == TUNED:
        integrator.set_maximum_step_size(_LONGEST)

    def run():
        context, y = simulator.get_mutable_context(), start(problem)
        callbacks.begin(y)
        system.events = 0
        context.SetTime(0.0)
        context.SetContinuousState(y)
        simulator.Initialize()
        rows = []
        for time in problem.times:
            simulator.AdvanceTo(time)
            rows.append(context.get_continuous_state_vector().CopyToVector())
        return Answer(lambda: np.array(rows), callbacks=callbacks.seconds)

    return run
