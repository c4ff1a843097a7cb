"""``study identify``: the parameters of the robot that made a recording, with intervals, and whether the model fits."""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from vibro_lab.identification.excitation import Excitation, excite, sensors_of
from vibro_lab.identification.identify import EFFECTS, WINDOW, Identification, identify
from vibro_lab.identification.nuisances import CAMERA
from vibro_lab.identification.unknowns import Unknowns
from vibro_lab.study.command import Results, StudyCommand, machine_of
from vibro_lab.study.execution import Execution
from vibro_lab.study.identification_page import identification_page
from vibro_ros import Parser, Scene, bag_errors, read_scalar, say, scene_as_file

SCENE, NUMBERS, PAGE, SCRIPT = "scene.yaml", "identification.json", "identification.html", "script.yaml"
#: What a laboratory recording tells of any scene, in this order; those that the scene does not have are left out.
DEFAULT = ("ground.friction", "mass.body", "guide.angle",
           *(f"{side}.{name}" for side in ("upper", "inclined") for name in (
               "spring.stiffness", "spring.damping", "plate.stiffness", "plate.damping", "gap")))


@dataclass(frozen=True)
class IdentificationDesign:
    """Arguments of `identify`, the bag None for a script alone; and the duration of a script [s], 0 for none."""

    bag: Path | None
    scene: Scene
    free: tuple[str, ...]
    ranges: dict[str, tuple[float, float]]
    noise: dict[str, float]
    effects: tuple[str, ...]
    offsets: dict[str, float]
    camera: tuple[str, ...]
    excite: float


def _add_options(parser: Parser) -> None:
    parser.add_argument("bag", type=Path, nargs="?", metavar="BAG", help="the recording: a folder with a bag of a "
                        "robot's topics; may be left out with --excite")
    parser.add_argument("--excite", type=float, default=0.0, metavar="SECONDS", help="write the script of so many "
                        "seconds that tells most of the free parameters, for the controller to play, with the standard "
                        f"deviations to expect ({SCRIPT}); of the scene, or with a BAG of the robot that was found and "
                        "with its sensors")
    parser.add_argument("--free", metavar="NAMES", help="parameters to find, separated by commas (default: friction, "
                        "mass, angle, and springs, dampers, plates and gaps that the scene has and that are not 0)")
    parser.add_argument("--range", action="append", default=[], metavar="NAME=LOW:HIGH", help="range in which a "
                        "parameter is searched, SI units; repeatable")
    parser.add_argument("--noise", action="append", default=[], metavar="SENSOR=SIGMA", help="standard deviation of a "
                        "sensor or channel, such as tracking=0.001 or odom.body_velocity=0.002; inf leaves it out; "
                        "repeatable (default: by the covariances in the messages, else by neighbouring values)")
    parser.add_argument("--effects", default="", metavar="NAMES", help="effects that are tried in addition, separated "
                        f"by commas: {', '.join(EFFECTS)}")
    parser.add_argument("--offset", action="append", default=[], metavar="SENSOR=SECONDS", help="by how much the "
                        "stamps of a sensor are late, such as odom=0.003, where that is known; repeatable (default: "
                        "found, up to 0.02 s either way)")
    parser.add_argument("--camera", default="", metavar="NAMES", help="what else is found of odom and tracking, "
                        f"separated by commas: {', '.join(CAMERA)}")


def _design_of(options: argparse.Namespace) -> IdentificationDesign:
    if options.scheduler:
        raise ValueError("--scheduler: a recording is fitted on this machine; leave it out")
    if options.bag is None and not options.excite:
        raise ValueError("no recording: give a BAG, or --excite SECONDS for a script to record one")
    scene = machine_of(options)
    free = _names(options.free) if options.free else tuple(
        name for name in DEFAULT if scene[name] or name.endswith(".gap"))
    ranges = {}
    for word in options.range:
        name, _, ends = word.partition("=")
        low, colon, high = ends.partition(":")
        if not colon:
            raise ValueError(f"--range {word}: give NAME=LOW:HIGH, such as ground.friction=0.1:0.4")
        ranges[name] = _number(word, low), _number(word, high)
    noise = {name: float("inf") if number == "inf" else _number(word, number)
             for word, name, number in _pairs("--noise", options.noise, "SENSOR=SIGMA, such as tracking=0.001")}
    offsets = {name: _number(word, number) for word, name, number in _pairs(
        "--offset", options.offset, "SENSOR=SECONDS, such as odom=0.003")}
    Unknowns.of(scene, free, ranges)  # refuses what cannot be free before the bag is read
    return IdentificationDesign(options.bag, scene, free, ranges, noise, _names(options.effects),
                                offsets, _names(options.camera), options.excite)


def _pairs(option: str, words: Sequence[str], form: str) -> Iterator[tuple[str, str, str]]:
    """Yield each word with the name and the number in it."""
    for word in words:
        name, equals, number = word.partition("=")
        if not equals:
            raise ValueError(f"{option} {word}: give {form}")
        yield word, name, number


def _names(words: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in words.split(",") if word.strip())


def _number(option: str, word: str) -> float:
    value = read_scalar(word)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{option}: {word} is no number; give one such as 0.1")
    return float(value)


def _results(design: IdentificationDesign, folder: Path, execution: Execution) -> Iterator[Results]:
    scene, sensors = design.scene, None
    if design.bag:
        with bag_errors(design.bag):
            identification = identify(
                design.bag, design.scene, design.free, design.ranges, design.noise, design.effects,
                execution.workers, design.offsets, design.camera, say=lambda words: say("study", words))
        comment = f"found by study identify in {design.bag.name}: {identification.verdict}"
        page = identification_page(identification, design.bag.resolve().name).encode()
        yield Results({SCENE: scene_as_file(identification.scene, comment), NUMBERS: numbers_of(identification),
                       PAGE: page}, identification.words())
        scene, sensors = identification.scene, sensors_of(identification.recording)
    if design.excite:
        best, *others = excite(scene, design.free, design.excite, sensors, design.ranges, execution.workers)
        yield Results({SCRIPT: best.script.encode()}, _words_of(best, others))


def _words_of(best: Excitation, others: Sequence[Excitation]) -> Iterator[str]:
    """Yield the lines on a script and on the candidates that tell less."""
    yield from best.script.partition("entries:")[0].replace("# ", "").splitlines()
    for excitation in others:
        untold, worst = excitation.worst
        yield f"{excitation.name}: the worst of {len(excitation.relative)} to {100.0 * worst:.2g} %" + (
            f", {untold} cannot be told" if untold else "")


def numbers_of(result: Identification) -> bytes:
    """Return the numbers of an identification as JSON."""
    document = {
        "values": result.values, "intervals": result.intervals, "covariance": result.covariance.tolist(),
        "rank": result.rank, "chi_square": result.chi_square, "p_value": result.p_value,
        "autocorrelation": result.autocorrelation, "verdict": result.verdict, "said": result.said,
        "passes": result.passes, "sensors": result.sensors,
        "outliers": {name: rows.tolist() for name, rows in result.outliers.items()},
        "profiles": {name: points.tolist() for name, points in result.profiles.items()},
        "windows": [dict(zip(WINDOW.names or (), row.tolist(), strict=True)) for row in result.windows],
        "alternatives": [{"effect": alternative.effect, "gain": alternative.gain, "p_value": alternative.p_value,
                          "values": alternative.values, "mean_square": alternative.mean_square}
                         for alternative in result.alternatives]}
    return (json.dumps(document, indent=1) + "\n").encode()


main = StudyCommand(
    "identify", "Find the parameters of the robot that made a recording, by a fit of the exact motion through every "
    "blow, with 95 % intervals. Writes the scene that was found, all numbers and a page, or the script to record next.",
    _add_options, _design_of, _results, goes_on=False)
