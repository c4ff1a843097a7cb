"""Drake: a `LeafSystem` in Python whose witness functions are the guards, under `Simulator`.

Its default integrator is RK3 with error control; the accuracy of the context also isolates the witnesses. Plain: the
accuracy is 1e-4; tuned: finer, with a longest step, and the bounces end where a flight would be shorter. MultibodyPlant
is not used, because its contact is compliant in a way of its own and its Coulomb friction is regularised.
"""

from importlib.metadata import version as _version

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem, UnrestrictedUpdateEvent, WitnessFunctionDirection

from benchmark.equations import begin, crossed, guards, machine, slope, start
from vibro_ros.accuracy.programs import PLAIN, TUNED, Answer, Setting

SETTINGS = (Setting(1e-4, "RK3, accuracy 1e-4", PLAIN), Setting(1e-6, "RK3, accuracy 1e-6", TUNED),
            Setting(1e-8, "RK3, accuracy 1e-8", TUNED))
_LONGEST = 1e-3  # s, a step: a witness that changes sign twice within one is not seen


def version():
    """Of the package."""
    return f"drake {_version('drake')}"


class _Machine(LeafSystem):
    """The eight states; the mode as three discrete numbers."""

    def __init__(self, problem, slow):
        super().__init__()
        self.numbers = machine(problem, slow)
        self.DeclareContinuousState(8)
        self.DeclareDiscreteState(3)
        self.witnesses = [self.MakeWitnessFunction(
            f"guard {k}", WitnessFunctionDirection.kPositiveThenNonPositive,
            lambda context, k=k: self.guard(context, k),
            UnrestrictedUpdateEvent(lambda context, event, state, k=k: self.cross(context, state, k)))
            for k in range(4)]

    @staticmethod
    def mode(context):
        upper, inclined, ground = context.get_discrete_state_vector().value()
        return bool(upper), bool(inclined), int(ground)

    def DoCalcTimeDerivatives(self, context, derivatives):  # noqa: N802 (Drake's name)
        out = np.empty(8)
        upper, inclined, ground = self.mode(context)
        slope(context.get_time(), context.get_continuous_state_vector().CopyToVector(), upper, inclined, ground,
              float(ground), self.numbers, out)
        derivatives.get_mutable_vector().SetFromVector(out)

    def DoGetWitnessFunctions(self, context):  # noqa: N802
        return self.witnesses

    def guard(self, context, k):
        out = np.empty(4)
        guards(context.get_time(), context.get_continuous_state_vector().CopyToVector(), *self.mode(context),
               self.numbers, out)
        return out[k]

    def cross(self, context, state, k):
        y = context.get_continuous_state_vector().CopyToVector()
        mode = crossed(context.get_time(), y, *self.mode(context), k, self.numbers)
        state.get_mutable_continuous_state().get_mutable_vector().SetFromVector(y)
        state.get_mutable_discrete_state(0).SetFromVector([float(value) for value in mode])


def prepare(problem, setting):
    """A run of one `Simulator` by the sampled instants."""
    system = _Machine(problem, slow=problem.parameters["g"] * _LONGEST if setting.use == TUNED else 0.0)
    simulator = Simulator(system)
    integrator = simulator.get_mutable_integrator()
    integrator.set_target_accuracy(setting.value)
    simulator.get_mutable_context().SetAccuracy(setting.value)
    if setting.use == TUNED:
        integrator.set_maximum_step_size(_LONGEST)

    def run():
        context, y = simulator.get_mutable_context(), start(problem)
        context.SetTime(0.0)
        context.SetContinuousState(y)
        context.SetDiscreteState([float(value) for value in begin(0.0, y, system.numbers)])
        simulator.Initialize()
        rows = []
        for time in problem.times:
            simulator.AdvanceTo(time)
            rows.append(context.get_continuous_state_vector().CopyToVector())
        return Answer(np.array(rows))

    return run
