"""`make picture`: the robot in slow motion, from a simulation, as an animated GIF."""

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from tools.mechanism import COLOURS, DARK, EDGE, HUB_HEIGHT, MM, Mechanism, legend
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.simulation.runs import simulate
from vibro_ros.simulation.samples import Run, Samples

OUTPUT = Path("docs/robot.gif")
SPEED = 100.0  # motor speed [rad/s], which must be commanded in `device`
SETTLED = 20.0  # s after which a robot that stood when it got its command has its usual motion, of two turns
TURNS = 4  # of the crank
FRAMES_PER_TURN = 40
SIZE = (8.4, 5.3)  # inches of 100 pixels
STAGE = 0.56  # share of the width
SAMPLES_PER_FRAME = 20  # of the traces
FRAME_TIME = 0.05  # s; a GIF's times are multiples of 0.01 s
GLOW = 0.004  # s, in which the light of an impact fades to 1/e; contacts last 0.3 ms, too short to be seen
COLOURS_IN_GIF = 128


class Animation:
    """Frames of the usual motion of the scene `device`, over `TURNS` crank turns."""

    def __init__(self) -> None:
        scene = load_scene("device")
        turn = math.tau / SPEED
        self.frames = TURNS * FRAMES_PER_TURN
        self._start = SETTLED
        times = np.linspace(0.0, TURNS * turn, SAMPLES_PER_FRAME * self.frames + 1)
        self._fine = simulate(scene, times=self._start + times, commands=[(0.0, {"motor_speed": SPEED})])
        self._figure = Figure(figsize=SIZE, dpi=100, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        slowdown = self.frames * FRAME_TIME / (TURNS * turn)
        self._draw_traces(self._figure, f"scene device at {SPEED:g} rad/s", slowdown)
        stage = self._figure.add_axes((0.0, 0.0, STAGE, 1.0))
        self._draw_ground(stage)
        self._mechanism = Mechanism(stage, scene)
        stage.legend(handles=legend(scene), loc="upper left", bbox_to_anchor=(0.01, 0.995), fontsize=8, frameon=False,
                     labelcolor=DARK, handlelength=1.6, labelspacing=0.35)
        self._force = {side: stage.text(0, 0, "", color=COLOURS[side], fontsize=11, weight="bold", ha="center",
                                        zorder=9) for side in scene.guides}
        self._ground_state = stage.text(0, -HUB_HEIGHT - 11, "", ha="left", fontsize=9, color=DARK)

    def _draw_ground(self, stage: Axes) -> None:
        x = self._fine.body_position * MM
        left, right = x.min() - 136, x.max() + 74
        stage.set(xlim=(left, right), aspect="equal", anchor="S")
        stage.set_ylim(-HUB_HEIGHT - 22, -HUB_HEIGHT - 22 + (right - left) * SIZE[1] / (SIZE[0] * STAGE))
        stage.axis("off")
        stage.plot([left, right], [-HUB_HEIGHT] * 2, color=DARK, lw=1.4, zorder=3)
        for mark in range(math.ceil(left / 10) * 10, int(right) + 1, 10):
            stage.plot([mark, mark], [-HUB_HEIGHT, -HUB_HEIGHT - (5 if mark % 50 == 0 else 3)], color=EDGE, lw=1)
        stage.text(right - 4, -HUB_HEIGHT - 16, "marks every 10 mm", ha="right", fontsize=8, color=EDGE)
        stage.plot([x[0], x[0]], [-HUB_HEIGHT, -HUB_HEIGHT + 20], color=EDGE, lw=1, ls=(0, (3, 3)), zorder=8)

    def _draw_traces(self, figure: Figure, title: str, slowdown: float) -> None:
        run, time = self._fine, self._milliseconds(self._fine.time)
        panels = [figure.add_axes((STAGE + 0.06, bottom, 0.92 - STAGE, height))
                  for bottom, height in ((0.72, 0.19), (0.43, 0.19), (0.1, 0.23))]
        body, hops, masses = panels
        traces = [(body, (run.body_position - run.body_position[0]) * MM, DARK), (hops, run.body_height * MM, DARK)]
        hops.set_title("height of the body above the ground [mm]", fontsize=9, loc="left", color=DARK)
        for side, colour in COLOURS.items():
            traces.append((masses, getattr(run, f"{side}_position") * MM, colour))
            masses.axhline(getattr(run, f"{side}_plate_position")[0] * MM, color=DARK, lw=1, ls=(0, (4, 3)))
        for axes, values, colour in traces:
            axes.plot(time, values, color=colour, lw=1.0, alpha=0.3)
        self._drawn = [(axes.plot([], [], color=colour, lw=1.8)[0],
                        axes.plot([], [], "o", color=colour, ms=5.5, mec="white", mew=0.8)[0], time, values)
                       for axes, values, colour in traces]
        for kind, side in (("upper_contact", "upper"), ("inclined_contact", "inclined")):
            struck = run.events[(run.events["kind"] == kind) & (run.events["time"] >= self._start)]["time"]
            masses.plot(self._milliseconds(struck), np.full(len(struck), run.upper_plate_position[0] * MM + 3.5), "v",
                        color=COLOURS[side], ms=6, mec="white", mew=0.6, clip_on=False)
        body.set_title("body displacement [mm]", fontsize=9, loc="left", color=DARK)
        masses.set_title("masses [mm], \N{BLACK DOWN-POINTING TRIANGLE} impacts, - - plates", fontsize=9, loc="left",
                         color=DARK, pad=8)
        masses.set_xlabel("time [ms]", fontsize=9, color=DARK)
        for axes in panels:
            axes.set_xlim(0, time[-1])
            axes.tick_params(labelsize=8, color=EDGE, labelcolor=DARK)
            axes.spines[["top", "right"]].set_visible(False)
            axes.spines[["left", "bottom"]].set_color(EDGE)
        figure.text(0.985, 0.965, f"{title}, slowed {slowdown:.0f} times", fontsize=8, color=EDGE, ha="right")

    def _milliseconds(self, time):
        return (time - self._start) * 1e3

    def images(self) -> Iterator[Image.Image]:
        """Yield each frame in turn."""
        for frame in range(self.frames):
            self._show(SAMPLES_PER_FRAME * frame)
            self._canvas.draw()
            yield Image.fromarray(np.asarray(self._canvas.buffer_rgba())).convert("RGB")

    def _show(self, index: int) -> None:
        state = _sample(self._fine, index)
        lights = {side: _last_impact(self._fine, side, state.time) for side in self._force}
        self._mechanism.show(state, {side: math.exp(-age / GLOW) for side, (age, _) in lights.items()})
        for side, (age, force) in lights.items():
            place = (36, 112) if side == "upper" else (-122, 95)
            self._force[side].set(position=(state.body_position * MM + place[0], place[1]),
                                  text=f"{force / 1e3:.1f} kN" if age < 4 * GLOW else "",
                                  alpha=min(1.0, math.exp(1.0 - age / (1.5 * GLOW))))
        self._ground_state.set(text=_ground_state(state), position=(state.body_position * MM - 88, -HUB_HEIGHT - 16))
        for line, dot, time, values in self._drawn:
            line.set_data(time[:index + 1], values[:index + 1])
            dot.set_data([time[index]], [values[index]])


def _sample(run: Run, index: int) -> Samples:
    return Samples(**{field.name: float(getattr(run, field.name)[index]) for field in dataclasses.fields(Samples)})


def _last_impact(run: Run, side: str, time: float) -> tuple[float, float]:
    """Time since the last contact began [s], and its peak force [N]; before the first contact the time is infinite."""
    contacts = run.events[(run.events["kind"] == f"{side}_contact") & (run.events["time"] <= time)]
    return (time - contacts["time"][-1], contacts["peak_force"][-1]) if len(contacts) else (math.inf, 0.0)


def _ground_state(state: Samples) -> str:
    if state.body_height > 0.0:
        return "body in the air"
    if state.normal_force <= 0.0:
        return "ground unloaded"
    return "body sticks" if state.body_velocity == 0.0 else "body slides"


def _common_palette(frames: list[Image.Image]) -> Image.Image:
    """Return one palette for all frames, made from some of them with impacts, so that still parts need no space."""
    chosen = frames[::FRAMES_PER_TURN // 11]
    strip = Image.new("RGB", (frames[0].width, len(chosen) * frames[0].height))
    for k, frame in enumerate(chosen):
        strip.paste(frame, (0, k * frame.height))
    return strip.quantize(COLOURS_IN_GIF, method=Image.Quantize.MAXCOVERAGE)


def write_gif(path: Path) -> int:
    """Write the animation; returns the file's size [bytes]."""
    frames = list(Animation().images())
    palette = _common_palette(frames)
    reduced = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    reduced[0].save(path, save_all=True, append_images=reduced[1:], duration=round(FRAME_TIME * 1e3), loop=0)
    return path.stat().st_size


if __name__ == "__main__":
    print(f"{OUTPUT}: {write_gif(OUTPUT) / 1e6:.2f} MB")
