"""Make the section of docs/speeds.md on the optimum: results of `study optimise`; `make documents ONLY=optimum`.

Each search is a command line that a reader can run.
"""

import argparse
import json
import math
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

import vibro_lab
import vibro_ros
from research.starts import computed, started
from tools.generated_text import write_between
from vibro_lab.study.optimise import VARIABLES

PAGE, FOLDER, FRONTS = Path("docs/speeds.md"), "optimum", "fronts.png"
MARKS = "<!-- optimum: written by `make documents` -->", "<!-- end of optimum -->"
LASTING, COMPARED, MOTIONS = "lasting.json", "compared.json", "motions.json"


class Search(NamedTuple):
    """A search of the report: its title, and the arguments of `study optimise`."""

    title: str
    words: str


_UNDAMPED = " ".join(f"--fix {side}.{part}.damping" for side in ("upper", "inclined") for part in ("spring", "plate"))
SEARCHES: Mapping[str, Search] = {
    "thriftiest": Search("V/P, whatever the speed", "--objective speed_per_power --budget 2000"),
    "thrifty": Search("V/P at 150 mm/s or more", "--objective speed_per_power --least-speed 0.15 --budget 1500"),
    "fastest": Search("Speed alone", "--objective speed"),
    "thrifty_grounded": Search("V/P at 50 mm/s or more, in the air for 2 % at most", "--objective speed_per_power "
                               "--least-speed 0.05 --most-air 0.02 --budget 1500"),
    "fastest_grounded": Search("Speed alone, in the air for 2 % at most", "--objective speed --most-air 0.02 --budget "
                               "1500"),
    "front": Search("The front itself", "--objective front"),
    "printed": Search("Speed by the paper's own rule", f"--scene paper --objective speed {_UNDAMPED}"),
    "printed_zero": Search("Speed by the paper's own rule, drawn starts that begin from zero", "--scene paper "
                           f"--set start.state=zero --objective speed --budget 2000 {_UNDAMPED}"),
    "unilateral": Search("Speed where the ground cannot pull",
                         f"--scene unilateral --objective speed {_UNDAMPED}"),
    "unilateral_zero": Search("Speed where the ground cannot pull, drawn starts that begin from zero", "--scene "
                              f"unilateral --set start.state=zero --objective speed --budget 2000 {_UNDAMPED}"),
}
"""Searches of the report, by the name of their files."""
#: Searches in the unchanged scene `device`, whose robots form the front.
OF_DEVICE = ("thriftiest", "thrifty", "fastest", "thrifty_grounded", "fastest_grounded",
             "front")
#: Optima that would move differently if the rule `unilateral` held their body on the ground.
HELD = ("thrifty", "fastest")
#: The paper's robots: the one of its conclusions, and the one of its parameters. Other values are the search's scene's.
PAPERS: Mapping[str, Mapping[str, float]] = {
    "paper's optimum": {"guide.angle": math.radians(80.0), "mass.inclined": 0.02, "crank.radius": 0.06},
    "paper's parameters": {}}
#: Numbers of the starts of these robots, of which the best is reported, and the measuring time [s] of each.
BEGINS, COMPARING = range(20_000, 20_016), 10.0
#: Motor speed [rad/s] of a scene whose motor stands still.
RUNNING = 100.0
#: Number of the starts whose motions are found, of optima that lose energy and so have attractors.
MOTION_STARTS = 64
#: Robots with long runs: the paper's first one, and optima of scenes without reaction on the masses.
WATCHED = ("paper", "printed", "printed_zero", "unilateral", "unilateral_zero")
#: Largest distance from the end of a range, as a share of the value, at which an optimum lies at that end.
AT_END = 0.02
#: Time of the verification of `study optimise`, in words.
VERIFIED = "over 10 s after 4 s"
#: Durations [s] of these runs after `SETTLING` [s], and their number of starts.
DURATIONS, SETTLING, STARTS = (4.0, 16.0, 64.0, 256.0), 4.0, 8

Numbers = dict[str, Any]
"""Contents of an optimum.json of `study optimise`."""


def main(words: Sequence[str]) -> int:
    """Run the searches and write the report; returns 0, or the exit code of the search that failed."""
    parser = argparse.ArgumentParser(prog="python -m research.optimum", description=__doc__)
    parser.add_argument("--work", type=Path, default=Path("out/study/optimum"), help="results of the searches; one "
                        "that is finished there is not repeated (default: %(default)s)")
    options = parser.parse_args(words)
    folder = PAGE.parent / FOLDER
    for name, search in SEARCHES.items():
        command = [sys.executable, "-m", "vibro_lab.study.command", "optimise", *search.words.split(), "--output",
                   str(options.work / name)]
        finished = (options.work / name / "optimum.json").is_file()
        if not finished and (code := subprocess.run(command, check=False).returncode):
            return code
        for ending in ("json", "yaml"):
            shutil.copy(options.work / name / f"optimum.{ending}", folder / f"{name}.{ending}")
    watched = {name: lasting(vibro_ros.load_scene(name if name == "paper" else folder / f"{name}.yaml"))
               for name in WATCHED}
    results = read_results(folder)
    papers = {name: papers_robots(name, result, folder) for name, result in results.items()}
    motions = motions_of_optima(folder)
    for file, numbers in ((LASTING, watched), (COMPARED, papers), (MOTIONS, motions)):
        (folder / file).write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    fronts_picture(results, papers["front"]).savefig(folder / FRONTS)
    write_between(PAGE, *MARKS, lambda: section(results, watched, papers, motions))
    print(PAGE)
    return 0


def read_results(folder: Path) -> dict[str, Numbers]:
    """Read the results of all searches, by name."""
    return {name: json.loads((folder / f"{name}.json").read_text(encoding="utf-8")) for name in SEARCHES}


def section(results: Mapping[str, Numbers], watched: Mapping[str, Sequence[Numbers]],
            papers: Mapping[str, Sequence[Numbers]], motions: Mapping[str, Sequence[Numbers]]) -> str:
    """Return the section in Markdown.

    `results` and `papers`, of `papers_robots` under the same forces, are by the name of the search; `watched`, of
    `lasting`, by the name of the search or `paper`; `motions` are those of `motions_of_optima`.
    """
    findings = "\n".join(f"- {text}" for text in (
        about_power(watched["paper"]), about_front(results, papers["front"]),
        about_thriftiest(results["thriftiest"], motions["thriftiest"]), about_flight(results, motions),
        about_decree(results, motions), about_undamped(results, watched), about_ends(results), about_hills(watched)))
    commands = "\n".join(f"study optimise {search.words}  # {name}" for name, search in SEARCHES.items())
    return "\n\n".join([
        f"{findings}",
        f"![Speed and cost of transport]({FOLDER}/{FRONTS})",
        "### The searches",
        "The table compares the slowest motion of each optimum with the paper's optimum, φ = 80°, m3 = 0.02 kg, "
        f"l = 0.06 m, under the same forces, at the best of its {len(BEGINS)} starts. An optimum by the paper's rules "
        f"loses no energy; of such an optimum the slowest of {STARTS} starts over {DURATIONS[-1]:g} s is compared. "
        f"V/P, time in the air and N are those of the usual motion of 16 other starts, {VERIFIED}. Parameters and the "
        f"verification under other forces stand in `docs/{FOLDER}/NAME.json`, the scene in `NAME.yaml`.",
        summary_table(results, watched, papers, motions), f"```bash\n{commands}\n```"])


def summary_table(results: Mapping[str, Numbers], watched: Mapping[str, Sequence[Numbers]],
                  papers: Mapping[str, Sequence[Numbers]], motions: Mapping[str, Sequence[Numbers]]) -> str:
    """Return a table with a line for each search."""
    heads = ["search", "faster than the paper's optimum by [mm/s]", "V/P [m/J]",
             "more than the paper's optimum [m/J]", "in the air", "N <= 0", "mean N over weight"]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name, result in results.items():
        best, paper = result["verified"][0], papers[name][0]
        pays = best["cost"] is not None
        cells = [f"{SEARCHES[name].title} (`{name}`)",
                 number(1e3 * (slowest(name, watched, motions) - paper["speed"])),
                 number(best["ratio"]["mean"]) if pays else "-",
                 number(best["ratio"]["mean"] - paper["ratio"]) if pays else "-",
                 f"{100 * best['air']:.1f} %", f"{100 * best['unloaded']:.0f} %", number(best["load"])]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def in_words(motion: Numbers) -> str:
    """Text of a motion of `settled_motions`: its speed, its period, and its share of the starts if it is not all."""
    if motion["starts"] == MOTION_STARTS:
        return motion["words"]
    return (f"{motion['words']} ({motion['starts']} of {MOTION_STARTS} starts, {100 * motion['low']:.0f} to "
            f"{100 * motion['high']:.0f} %)")


def ends(row: Numbers) -> str:
    """Text of the slowest and the fastest start of a row of `lasting` [m/s]."""
    return f"{number(row['slowest'])} to {number(row['fastest'])}"


def slowest(name: str, watched: Mapping[str, Sequence[Numbers]], motions: Mapping[str, Sequence[Numbers]]) -> float:
    """Speed [m/s] of the slowest motion of an optimum, or of its slowest start over the longest of `DURATIONS`."""
    if name in motions:
        return min(abs(motion["speed"]) for motion in motions[name])
    return abs(watched[name][-1]["slowest"])


def about_power(rows: Sequence[Numbers]) -> str:
    """Paragraph on why V/P has no bound by the paper's equations."""
    first, last = rows[0], rows[-1]
    return (f"By the paper's equations V/P has no bound: from {first['duration']:g} to {last['duration']:g} s the "
            f"largest mean power of {STARTS} starts of the scene `paper` falls from {number(first['power'])} to "
            f"{number(last['power'])} W, at the same speed. The masses do not feel the body move (`effects.reaction` "
            "false), do not pay for its friction, and lose nothing without dampers, so that the work of the motor is "
            "the bounded change of their stored energy. Therefore V/P is sought in `device`, where energy balances.")


def about_front(results: Mapping[str, Numbers], papers: Sequence[Numbers]) -> str:
    """Paragraph on the extent of the front of all searches, and its robots that are better than the paper's."""
    front = front_of_all(results)
    text = ("No robot that was tried is both faster and cheaper than a robot of the *front*, which the picture shows. "
            f"The front reaches from {number(1e3 * front[0]['speed'])} mm/s at a cost of transport of "
            f"{number(front[0]['cost'])} to {number(1e3 * front[-1]['speed'])} mm/s at {number(front[-1]['cost'])}.")
    for row in papers:
        better = [robot for robot in front if robot["speed"] > row["speed"] and robot["cost"] < row["cost"]]
        if better:
            text += (f" The best start of the {row['robot']} goes at {number(1e3 * row['speed'])} mm/s at a cost of "
                     f"{number(row['cost'])}; the front has a robot of {number(1e3 * better[0]['speed'])} mm/s at "
                     f"{number(better[0]['cost'])}.")
    return text


def front_of_all(results: Mapping[str, Numbers]) -> list[Numbers]:
    """Non-dominated robots (speed, cost) of all searches in `device`, the slowest first: those that a search tried,
    with the lower quartile of their starts, and each optimum with the usual motion of its verification.
    """
    optima = ({"speed": abs(best["speed"]["mean"]), "cost": best["cost"]}
              for best in (results[name]["verified"][0] for name in OF_DEVICE))
    robots = sorted([*optima, *(robot for name in OF_DEVICE for robot in results[name]["front"])],
                    key=lambda robot: -robot["speed"])
    front: list[Numbers] = []
    for robot in robots:
        if not front or robot["cost"] < front[-1]["cost"]:
            front.append(robot)
    return front[::-1]


def about_thriftiest(result: Numbers, motions: Sequence[Numbers]) -> str:
    """Paragraph on the slow robot that V/P alone selects."""
    row = result["verified"][0]
    return (f"V/P alone asks for a slow robot, {in_words(motions[0])}. For each newton of its weight and each metre of "
            f"its way the robot needs {number(row['cost'])} J. Somebody who drags the same body over the same ground "
            "needs 0.2 J, because the friction coefficient is 0.2. A front of speed and cost of transport is the "
            "better question.")


def about_flight(results: Mapping[str, Numbers], motions: Mapping[str, Sequence[Numbers]]) -> str:
    """Paragraph on optima that hop, and on searches that limit the time in the air."""
    shares = ", ".join(f"{100 * results[name]['verified'][0]['air']:.0f} % (`{name}`)"
                       for name in ("thriftiest", "thrifty", "fastest"))
    grounded = []
    for name in ("thrifty_grounded", "fastest_grounded"):
        best = results[name]["verified"][0]
        grounded.append(f"{'; '.join(map(in_words, motions[name]))}, at {number(best['ratio']['mean'])} m/J (`{name}`)")
    return (f"In `device` most optima hop: the body is in the air for {shares} of the time. The model has no pitch, so "
            "that a body in the air cannot tumble. A robot without a guide against pitching should stay on the ground "
            "by itself. With `hop`, and in the air for 2 % of the time at most, the searches found "
            f"{' and '.join(grounded)}.")


def about_decree(results: Mapping[str, Numbers], motions: Mapping[str, Sequence[Numbers]]) -> str:
    """Paragraph on why no optimum is searched for with the body held on the ground (`unilateral`)."""
    held = []
    for name in HELD:
        forced = rows_of(results[name], "by decree")
        held.append(f"`{name}` would go at {' or '.join(map(in_words, motions[f'{name}, held']))}, not "
                    f"{' or '.join(number(1e3 * motion['speed']) for motion in motions[name])} mm/s, with a mean N of "
                    f"{number(forced[0]['load'])} times the weight in its usual motion")
    return ("`unilateral` in place of `hop` finds no robot that stays on the ground: the rule holds the body there by "
            "decree, and breaks the balance of momentum, by which the mean of N in a steady motion is the weight. Held "
            f"so, {'; '.join(held)}.")


def about_undamped(results: Mapping[str, Numbers], watched: Mapping[str, Sequence[Numbers]]) -> str:
    """Paragraph on the unrealistic speeds of optima by the paper's own rules."""
    sentences = []
    for name in ("printed", "unilateral"):
        short, long = watched[name][0], watched[name][-1]
        sentences.append(
            f"{STARTS} starts of `{name}` go at {ends(long)} m/s over {long['duration']:g} s ({ends(short)} m/s over "
            f"the first {short['duration']:g} s), with a mean N of "
            f"{number(results[name]['verified'][0]['load'])} times the weight; with every effect of `device` they go "
            f"at {range_of(rows_of(results[name], 'every effect of `device`'))} m/s.")
    return ("Speed has an optimum by the paper's own rules, too, but nobody should build it: without dampers and "
            f"reaction the masses keep what they gain near resonance, and no start settles. {' '.join(sentences)}")


def about_ends(results: Mapping[str, Numbers]) -> str:
    """Paragraph on the optima that lie at an end of a range, so that a wider range may have a better robot."""
    ends_of = {name: [variable.name for variable in VARIABLES if variable.name in result["optimum"] and any(
        math.isclose(result["optimum"][variable.name], end, rel_tol=AT_END) for end in (variable.low, variable.high))]
        for name, result in results.items()}
    lists = "; ".join(f"`{name}` of {', '.join(f'`{end}`' for end in names)}"
                      for name, names in ends_of.items() if names)
    return (f"Most of these robots lie at an end of the range of a parameter, so that a wider range may have a better "
            f"one: {lists}.")


def about_hills(watched: Mapping[str, Sequence[Numbers]]) -> str:
    """Paragraph on optima that a search may miss, from searches whose starts begin from `rest` and from `zero`."""
    pairs = [f"{ends(watched[f'{name}_zero'][-1])} m/s (`{name}_zero`), where `{name}`, which was sought from `rest`, "
             f"goes at {ends(watched[name][-1])} m/s" for name in ("printed", "unilateral")]
    return ("No search proves an optimum. With drawn starts that begin from `zero`, the searches for speed by the "
            f"paper's rules found robots that go at {' and at '.join(pairs)}; all over {DURATIONS[-1]:g} s.")


def rows_of(result: Numbers, words: str) -> list[Numbers]:
    """Verified rows of a reading of the forces, that of most starts first."""
    return [row for row in result["verified"] if words in row["reading"]]


def range_of(rows: Sequence[Numbers]) -> str:
    """Text of the slowest and fastest mean speed of several rows; no mean over them."""
    values = sorted({number(row["speed"]["mean"]) for row in rows}, key=lambda text: abs(float(text)))
    return " to ".join([values[0], values[-1]] if len(values) > 1 else values)


def number(value: float) -> str:
    """Format `value` with three digits."""
    text = f"{value:.3g}"
    return f"{float(text):.0f}" if 1e3 <= abs(float(text)) < 1e6 else text


def motions_of_optima(folder: Path) -> dict[str, list[Numbers]]:
    """Return `settled_motions` of each optimum in `device` by the name of its search; those of `HELD` also with the
    body held on the ground, by the name with `, held`.
    """
    scenes = {name: vibro_ros.load_scene(folder / f"{name}.yaml") for name in OF_DEVICE}
    held = {f"{name}, held": scenes[name].with_parameters({"effects.normal_force": "unilateral"}) for name in HELD}
    return {name: settled_motions(scene) for name, scene in {**scenes, **held}.items()}


def settled_motions(scene: vibro_ros.Scene, starts: int = MOTION_STARTS) -> list[Numbers]:
    """Find the motions to which drawn starts of an optimum lead, that of most starts first; speeds in m/s."""
    return [{"words": motion.in_words(), "speed": motion.mean_speed, "starts": motion.starts, "low": motion.low,
             "high": motion.high} for motion in vibro_lab.attractors(scene, starts).drawn]


def papers_robots(name: str, result: Numbers, folder: Path) -> list[Numbers]:
    """Run the paper's robots under the forces of a search; returns the best speed [m/s], V/P [m/J] and cost of each.

    Each value is that of one start, because several motions of a robot have no common mean.
    """
    sought = vibro_ros.load_scene(folder / f"{name}.yaml")
    words = SEARCHES[name].words.split()
    base = vibro_ros.load_scene(words[words.index("--scene") + 1] if "--scene" in words else "device")
    usual = {parameter: base[parameter] or RUNNING if parameter == "motor.speed" else base[parameter]
             for parameter in result["optimum"]}
    rows = []
    for robot, changes in PAPERS.items():
        scene = sought.with_parameters({**usual, **changes})
        runs = np.array(computed(_watched, [(scene, start, (COMPARING,)) for start in BEGINS], f"{name}: {robot}"))
        speed, power = np.abs(runs[:, 0, 0]), runs[:, 0, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(power > 0.0, speed / power, 0.0)
        weight = scene.total_mass * scene["gravity"]
        rows.append({"robot": robot, "speed": float(speed.max()), "ratio": float(ratio.max()),
                     "cost": float(1.0 / (weight * ratio.max()))})
    return rows


def lasting(scene: vibro_ros.Scene) -> list[Numbers]:
    """Slowest and fastest speed [m/s] and largest power [W] of the same starts, over each of `DURATIONS`.

    No mean is given, because several motions have no common one.
    """
    runs = np.array(computed(_watched, [(scene, start, DURATIONS) for start in range(STARTS)],
                             f"{scene.name} for long"))
    return [{"duration": duration, "slowest": float(speed[np.argmin(np.abs(speed))]),
             "fastest": float(speed[np.argmax(np.abs(speed))]), "power": float(np.abs(power).max())}
            for duration, (speed, power) in zip(DURATIONS, runs.transpose(1, 2, 0), strict=True)]


def _watched(job: tuple[vibro_ros.Scene, int, Sequence[float]]) -> list[tuple[float, float]]:
    """Mean speed [m/s] and mean power [W] of one start over each duration [s]."""
    scene, start, durations = job
    device = started(scene.with_parameters({"solver.accounts": True}), np.random.default_rng(start))
    device.advance_to(SETTLING)
    begin, earlier_accounts = device.state.body_position, dict(device.statistics["energy_accounts"])
    rows = []
    for duration in durations:
        span = whole_turns(scene, duration)
        device.advance_to(SETTLING + span)
        accounts = device.statistics["energy_accounts"]
        given, back = (accounts[name] - earlier_accounts[name] for name in ("motor_delivered", "motor_taken_back"))
        rows.append(((device.state.body_position - begin) / span, (given - back) / span))
    return rows


def whole_turns(scene: vibro_ros.Scene, duration: float) -> float:
    """Time of the whole turns of the crank within `duration` [s], in s; means over whole turns have no oscillation."""
    turn = 2.0 * math.pi / scene["motor.speed"]
    return math.floor(duration / turn) * turn


def fronts_picture(results: Mapping[str, Numbers], papers: Sequence[Numbers]) -> Figure:
    """Draw the fronts of the searches in `device`, their common front, and the robots of the paper."""
    figure = Figure(figsize=(8.0, 5.5), layout="constrained")
    axes = figure.subplots()
    for name in OF_DEVICE:
        _draw(axes, results[name]["front"], "o", name)
    _draw(axes, front_of_all(results), "k-", "front of them all")
    for row, mark in zip(papers, "sD", strict=True):
        axes.plot(1e3 * row["speed"], row["cost"], mark, ms=8.0, label=row["robot"])
    axes.set(xscale="log", yscale="log", xlabel="mean speed [mm/s]", ylabel="cost of transport, dimensionless")
    axes.legend(frameon=False, fontsize=8)
    return figure


def _draw(axes: Any, robots: Sequence[Numbers], style: str, label: str) -> None:
    axes.plot([1e3 * robot["speed"] for robot in robots], [robot["cost"] for robot in robots], style, ms=4.0,
              label=label)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
