"""`make picture`: draw the robot to scale with the names of its parts, the first picture of docs/robot.md."""

import dataclasses
import math
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from tools.mechanism import COLOURS, DARK, FREE_LENGTH, HUB_HEIGHT, MASS_HEIGHT, MM, Mechanism
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.model.slider import Slider
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

OUTPUT = Path("docs/robot.svg")
SPEED = 1.0  # rad/s, so slow that the masses follow their sliders
ANGLE = math.radians(150.0)  # of the crank, where both masses are clear of their plates
SIZE = (8.4, 5.7)  # inches of 100 pixels: as wide as a page shows a picture
LEFT, RIGHT, BOTTOM = -213.0, 147.0, -72.0  # mm, edges of the picture
NAMES = {"upper": 44.0, "inclined": -44.0}  # mm from the guide's axis to the names of its parts
THETA_RADIUS = 31.0  # mm
LINE = 9.0  # mm between lines of text
FORCE = "#a3262a"

#: Symbols of each guide: coordinate, slider, plate, rod, mass, drive, contact.
SYMBOLS = {"upper": ("u", "s_B", "E", "L_2", "m_2", "k_2, c_2", "k_4, c_4"),
           "inclined": ("w", "s_C", "H", "L_3", "m_3", "k_3, c_3", "k_1, c_1")}


class Drawing:
    """The robot of a scene that has both masses, with the names of its parts, its axes and its forces on the ground."""

    def __init__(self, scene: Scene):
        self._scene, self._state = scene, _slow_state(scene)
        self.figure = Figure(figsize=SIZE, facecolor="white")
        self._axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self._axes.set(xlim=(LEFT, RIGHT), ylim=(BOTTOM, BOTTOM + (RIGHT - LEFT) * SIZE[1] / SIZE[0]), aspect="equal")
        self._axes.axis("off")
        self._axes.plot([LEFT + 4, RIGHT - 4], [-HUB_HEIGHT] * 2, color=DARK, lw=1.4, zorder=3)
        Mechanism(self._axes, scene).show(self._state, {})
        for side in SYMBOLS:
            self._name_guide(side)
        self._name_crank()
        self._name_body_and_ground()

    def write(self, path: Path) -> int:
        """Write the picture as SVG, the same text for the same scene; returns the file's size [bytes]."""
        with matplotlib.rc_context({"svg.hashsalt": "robot"}):
            FigureCanvasSVG(self.figure).print_svg(path, metadata={"Date": None})
        return path.stat().st_size

    def _name_guide(self, side: str) -> None:
        """Name the parts along one guide, and draw the lengths that are coordinates, and their positive direction."""
        coordinate, slider, plate, rod, mass, drive, contact = (f"${symbol}$" for symbol in SYMBOLS[side])
        at_slider, at_mass, at_plate = self._places(side)
        rod_across, rod_along = 0.4 * self._pin(side) + [0.0, 0.6 * at_slider]
        sign = math.copysign(1.0, NAMES[side])
        names = [(f"connecting rod, {rod}", rod_across, rod_along), (f"slider, at {slider}", 9.0 * sign, at_slider),
                 (f"drive spring and damper, {drive}", 6.0 * sign, (at_slider + at_mass) / 2),
                 (f"{side} mass, {mass}", 11.0 * sign, at_mass + MASS_HEIGHT / 2),
                 (f"plate, at {plate}", 12.0 * sign, at_plate + 2.0),
                 (f"its spring and damper, {contact}", 8.0 * sign, at_plate + 9.0)]
        least = LINE / abs(self._scene.direction(side)[1])  # along the guide, for lines of text one above the other
        for place, (name, across, along) in zip(_apart([along for *_, along in names], least), names, strict=True):
            self._name_part(name, self._at(side, across, along), self._at(side, NAMES[side], place), sign)
        self._length(side, 30.0 * sign, 0.0, at_slider, slider)
        self._length(side, -19.0 * sign, at_mass + MASS_HEIGHT, at_plate, f"{plate[:-1]} - {coordinate[1:]}")
        self._arrow(self._at(side, 0.0, at_plate + 23.0), self._at(side, 0.0, at_plate + 38.0), coordinate)

    def _places(self, side: str) -> tuple[float, float, float]:
        """Positions of slider, mass and plate on the drawn guide [mm], for mass and plate those of the nearer faces."""
        scene = self._scene
        slider = Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], scene.guide_angle(side))
        mass, plate = (getattr(self._state, f"{side}_{part}") * MM + FREE_LENGTH for part in (
            "position", "plate_position"))
        return float(slider.position(self._state.crank_angle)) * MM, mass, plate + MASS_HEIGHT

    def _pin(self, side: str) -> np.ndarray:
        """Position of the crank's pin to the right of a guide's axis, and along the guide [mm], shape (2,)."""
        angle = self._state.crank_angle - self._scene.guide_angle(side)
        return self._scene["crank.radius"] * MM * np.array([-math.sin(angle), math.cos(angle)])

    def _at(self, side: str, across: float, along: float) -> np.ndarray:
        """Point of the picture [mm] at the distance `across` to the right of a guide's axis and `along` the guide."""
        out, up = self._scene.direction(side)
        return along * np.array([out, up]) + across * np.array([up, -out])

    def _name_part(self, name: str, part: np.ndarray, end: np.ndarray, sign: float) -> None:
        """Draw a line from a part to its name, whose text extends to the right for a positive `sign`, else to the left.
        """
        self._axes.plot(*np.transpose([part, end]), color=DARK, lw=0.6, zorder=9)
        self._axes.plot(*part, "o", color=DARK, ms=2.0, zorder=9)
        self._text(end + [2.0 * sign, 0.0], name, ha="left" if sign > 0.0 else "right")

    def _length(self, side: str, across: float, start: float, end: float, name: str) -> None:
        """Draw a dimension line beside the guide, for a length along it."""
        ends = [self._at(side, across, along) for along in (start, end)]
        self._axes.annotate("", ends[0], ends[1], zorder=9,
                            arrowprops={"arrowstyle": "<->", "color": COLOURS[side], "lw": 1.0, "shrinkA": 0,
                                        "shrinkB": 0})
        self._text(self._at(side, across + math.copysign(4.0, across), 0.75 * start + 0.25 * end), name,
                   ha="right" if across < 0.0 else "left", color=COLOURS[side])

    def _arrow(self, start: np.ndarray, end: np.ndarray, name: str, color: str = DARK) -> None:
        """Draw an arrow with a name at its end."""
        self._axes.annotate("", end, start, zorder=9, arrowprops={
            "arrowstyle": "-|>", "color": color, "lw": 1.4, "shrinkA": 0, "shrinkB": 0})
        beyond = (end - start) / np.hypot(*(end - start))
        self._text(end + 6.0 * beyond, name, color=color, ha="center")

    def _text(self, place: np.ndarray, text: str, ha: str, color: str = DARK) -> None:
        self._axes.text(*place, text, ha=ha, va="center", fontsize=9, color=color, zorder=10)

    def _name_crank(self) -> None:
        """Name the crank and its centre, and draw its angle, from the vertical towards -x."""
        turns = np.linspace(0.0, self._state.crank_angle, 60)
        arc = THETA_RADIUS * np.array([-np.sin(turns), np.cos(turns)])
        self._axes.plot(*arc, color=DARK, lw=1.0, zorder=8)
        self._axes.annotate("", arc[:, -1], arc[:, -4], zorder=9, arrowprops={
            "arrowstyle": "-|>", "color": DARK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0})
        self._text((THETA_RADIUS + 6.0) * np.array([-math.sin(0.45), math.cos(0.45)]), "θ, ω", ha="center")
        for point, end, name in ((self._at("upper", *self._pin("upper")) / 2.0, np.array([44.0, -14.0]), "crank, $l$"),
                                 (np.zeros(2), np.array([44.0, -3.0]), "centre $D$")):
            self._name_part(name, point, end, 1.0)

    def _name_body_and_ground(self) -> None:
        """Name the body, and draw its axes and the forces of the ground on it, in their positive directions."""
        ground = -HUB_HEIGHT
        self._text(np.array([-18.0, ground + 4.0]), "body, $m_1$", ha="center")
        self._arrow(np.array([76.0, ground]), np.array([104.0, ground]), "$x$")
        self._arrow(np.array([76.0, ground]), np.array([76.0, ground + 28.0]), "$y$")
        self._arrow(np.array([-18.0, ground - 20.0]), np.array([-18.0, ground]), "", FORCE)
        self._text(np.array([-15.0, ground - 14.0]), "$N$", ha="left", color=FORCE)
        self._arrow(np.array([52.0, ground - 4.0]), np.array([24.0, ground - 4.0]), "", FORCE)
        self._text(np.array([38.0, ground - 11.0]), "$F_{fr}$, friction $μ$", ha="center", color=FORCE)


def _apart(places: list[float], least: float) -> list[float]:
    """Return the places moved apart, each at least `least` [mm] beyond the one before, with the same mean."""
    spread = [places[0]]
    for place in places[1:]:
        spread.append(max(place, spread[-1] + least))
    return list(np.array(spread) - (sum(spread) - sum(places)) / len(places))


def _slow_state(scene: Scene) -> Samples:
    """Return the state at crank angle `ANGLE` of a slow turn, with the crank's centre above the origin."""
    device = Simulator(scene.with_parameters({"motor.speed": SPEED, "effects.motor": "ideal"}))
    device.advance_to(ANGLE / SPEED)
    return dataclasses.replace(device.state, body_position=0.0, body_height=0.0)


if __name__ == "__main__":
    print(f"{OUTPUT}: {Drawing(load_scene('device')).write(OUTPUT) / 1e3:.0f} kB")
