"""Published robots that were measured, as far as their texts could be read, and what is missing to reproduce them.

No row has a number that was not read. A source whose parameters are all known becomes a study of its own, with a
mapping and a check, and leaves this table.
"""

from typing import NamedTuple


class MeasurementSource(NamedTuple):
    """A source with measurements of a robot."""

    source: str  # citation in Markdown
    read: str  # part of it that could be read
    reports: str  # measurements and parameters that this part reports or announces
    missing: str  # what the model would need and this part does not give


SOURCES = (
    MeasurementSource(
        "Y. Yan, Y. Liu, J. Páez Chávez, F. Zonta, A. Yusupov, *Proof-of-concept prototype development of the "
        "self-propelled capsule system for pipeline inspection*, 2017, "
        "[10.1007/s11012-017-0801-3](https://doi.org/10.1007/s11012-017-0801-3)",
        "abstract, beginning of the introduction",
        "a capsule in a dry uPVC pipe; impact stiffness, frequency and amplitude of the excitation were varied in "
        "experiments",
        "every number: masses, stiffnesses, gap, friction, force of the solenoid over time, speeds. A solenoid pushes "
        "a rod, no crank does"),
    MeasurementSource(
        "Y. Liu, J. Páez Chávez, J. Zhang, J. Tian, B. Guo, S. Prasad, *The vibro-impact capsule system in millimetre "
        "scale: numerical optimisation and experimental verification*, Meccanica, 2020, "
        "[10.1007/s11012-020-01237-8](https://doi.org/10.1007/s11012-020-01237-8)",
        "abstract, beginning of the introduction",
        "length 26 mm, diameter 11 mm; up to 14.4 mm/s by the authors' own model; experiments are compared with it",
        "masses, stiffnesses, gap, friction, drive, and the measured speeds"),
    MeasurementSource(
        "*Design and experimental investigation of a vibro-impact self-propelled capsule robot with orientation "
        "control*, [arXiv:2202.11784](https://arxiv.org/abs/2202.11784)",
        "abstract, beginning of the introduction",
        "four coils move a magnet within the capsule; two strategies of control in simulation and experiment",
        "every number; the magnet's force depends on its place"),
    MeasurementSource(
        "N.-T. La, T.-T. Nguyen, V.-D. Nguyen, *A comparative study on the two vibration driven locomotion systems in "
        "various friction levels*, Vietnam J. Mech. 43 (2021) 121–137, "
        "[10.15625/0866-7136/15662](https://doi.org/10.15625/0866-7136/15662)",
        "abstract, most of it",
        "two systems, one of which strikes a stop; friction was varied without the masses, and both models were "
        "compared with experiments",
        "every number"),
    MeasurementSource(
        "V. Korendiy, O. Kachur, *Locomotion characteristics of a wheeled vibration-driven robot with an enhanced "
        "pantograph-type suspension*, Front. Robot. AI, 2023, "
        "[10.3389/frobt.2023.1239137](https://doi.org/10.3389/frobt.2023.1239137)",
        "abstract, most of it",
        "accelerations were measured at several voltages; the smallest speed is about 1 mm/s",
        "masses, springs, friction of the wheels, the other speeds. An unbalanced rotor drives it, no crank, and it "
        "has no plate"),
    MeasurementSource(
        "I. A. Loukanov, S. P. Stoyanov, *Experimental determination of dynamic characteristics of a vibration-driven "
        "robot*, IOSR J. Mech. Civ. Eng. 12 (4), 2015, 62–73",
        "abstract",
        "spring constant, natural frequency and damping were identified from free oscillations with the chassis held; "
        "accelerations of shaker and chassis, and the towing force, were recorded while it drove",
        "every number; speeds are not announced. Unbalanced rotors, one-way wheels, no plate"))


def section() -> str:
    """Return the section in Markdown."""
    rows = [f"| {row.source} | {row.read} | {row.reports} | {row.missing} |" for row in SOURCES]
    return "\n".join([
        "## Measured vibration robots",
        "",
        "*Which measured robot does this model reproduce?* None. No text that could be read here gives all parameters "
        "of a robot that was built and measured, so that nothing is compared. Only the beginnings of the texts below "
        "were in reach; some of them are open access, and a reader who has the whole text can complete the row.",
        "",
        "| source | read | reports | missing |", "|---|---|---|---|", *rows,
        "",
        "To compare a robot with this model, a laboratory would have to record the following;",
        "[identification](guide/identification.md) says with which sensors, and how closely the parameters "
        "are then known:",
        "",
        "- the masses of body, sliders and internal masses, the lengths of crank and rods, the gaps, and the slope of "
        "the ground;",
        "- force over deflection of each spring and plate, and a free decay of each mass with the body held, which "
        "gives its damping; for a rigid plate the speeds before and after single impacts;",
        "- the force that starts and the force that keeps the body sliding, forwards and backwards, at two loads at "
        "least, before and after the runs: their scatter limits how closely a speed can be predicted;",
        "- the crank's angle over time, not its mean speed alone, with voltage and current of the motor;",
        "- the body's position over a hundred turns of the crank or more after it has settled, from several starts at "
        "each command, because one command may have several motions; runs that were discarded, too."])
