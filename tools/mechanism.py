"""Movable drawing of the mechanism to scale [mm]: body, crank, rods, sliders, springs, masses and plates.

A mass has the same position as its slider where its drive spring is unstretched, so the drawing sets each mass
`FREE_LENGTH` farther along the guide. This length and the outlines are the only dimensions that the scene does not give
(`messages.urdf` has those that the URDF shares).
"""

import math

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyBboxPatch, Patch, Polygon, Rectangle
from matplotlib.transforms import Affine2D, Transform

from vibro_ros.messages import urdf
from vibro_ros.model.scene import Scene
from vibro_ros.model.slider import Slider
from vibro_ros.simulation.samples import Samples

MM = 1e3  # mm/m
FREE_LENGTH = urdf.FREE_LENGTH * MM
MASS_HEIGHT = urdf.MASS_HEIGHT * MM
HUB_HEIGHT = 44.0  # height of the crank's centre above the ground
RAIL = urdf.RAIL * MM
ARC = 74.0  # radius of the arc that shows the guides' angle, between the guides
HEADROOM = urdf.HEADROOM * MM

COLOURS = {"upper": "#0072b2", "inclined": "#d55e00"}  # as in report.png
BODY, EDGE, METAL, DARK, FLASH = "#e7ebf0", "#8a95a3", "#b4bcc6", "#3a424c", "#ffc93c"


class Mechanism:
    """The robot in a picture with the unit millimetre; both axes must have the same scale."""

    def __init__(self, axes: Axes, scene: Scene):
        self._shift = Affine2D()
        self._radius = scene["crank.radius"] * MM
        moving = self._shift + axes.transData
        self._draw_body(axes, scene, moving)
        self._guides = [_Guide(axes, scene, side, moving) for side in scene.guides]
        axes.add_patch(Circle((0, 0), self._radius + 5, fc="white", ec=EDGE, lw=1.2, transform=moving, zorder=3))
        self._crank, = axes.plot([], [], color=DARK, lw=4, solid_capstyle="round", transform=moving, zorder=6)
        self._pin, = axes.plot([], [], "o", color=DARK, ms=7, mfc="white", mew=2, transform=moving, zorder=7)
        axes.plot([0], [0], "o", color=DARK, ms=5, transform=moving, zorder=7)
        if scene.guides:
            self._draw_angle(axes, scene["guide.angle"], moving)

    def _draw_angle(self, axes: Axes, angle: float, moving: Transform) -> None:
        """Draw the angle φ, from the vertical to the inclined guide's axis."""
        turns = np.linspace(0.0, angle, 30)
        axes.plot(-ARC * np.sin(turns), ARC * np.cos(turns), color=DARK, lw=1.0, transform=moving, zorder=8)
        along = np.linspace(8.0, ARC + 4.0, 3)
        for end in (0.0, angle):
            axes.plot(-along * math.sin(end), along * math.cos(end), color=DARK, lw=0.7, ls=(0, (6, 2, 1, 2)),
                      transform=moving, zorder=8)
        axes.text(-(ARC + 7) * math.sin(angle / 2), (ARC + 7) * math.cos(angle / 2), "φ", fontsize=11, ha="center",
                  va="center", color=DARK, transform=moving, zorder=8)

    def _draw_body(self, axes: Axes, scene: Scene, moving: Transform) -> None:
        """Draw sled and column; the guides draw their own housings."""
        sled = Polygon([(-88, -HUB_HEIGHT), (52, -HUB_HEIGHT), (60, -HUB_HEIGHT + 8), (-96, -HUB_HEIGHT + 8)],
                       closed=True, joinstyle="round", fc=BODY, ec=EDGE, lw=1.2, transform=moving, zorder=2)
        column = Polygon([(-38, -HUB_HEIGHT + 8), (30, -HUB_HEIGHT + 8), (20, 0), (-20, 0)], closed=True,
                         fc=BODY, ec=EDGE, lw=1.2, transform=moving, zorder=1)
        axes.add_patch(column)
        axes.add_patch(sled)

    def show(self, state: Samples, glow: dict[str, float]) -> None:
        """Move all parts to `state`; `glow`, 0 to 1, is the brightness of each guide's plate."""
        self._shift.clear().translate(state.body_position * MM, state.body_height * MM)
        angle = state.crank_angle
        pin = self._radius * np.array([-math.sin(angle), math.cos(angle)])
        self._crank.set_data([0, pin[0]], [0, pin[1]])
        self._pin.set_data([pin[0]], [pin[1]])
        for guide in self._guides:
            guide.show(state, glow.get(guide.side, 0.0))


class _Guide:
    """One guide, drawn upright in its own frame, which is then rotated."""

    def __init__(self, axes: Axes, scene: Scene, side: str, moving: Transform):
        self.side = side
        self._angle = scene.guide_angle(side)
        self._slider = Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], self._angle)
        frame = Affine2D().rotate(self._angle) + moving
        end = (scene[f"crank.{side}_rod"] + scene[f"{side}.gap"]) * MM + FREE_LENGTH + MASS_HEIGHT + HEADROOM
        self._end = end
        axes.add_patch(Rectangle((-RAIL, 12), 2 * RAIL, end - 12, fc=BODY, ec=EDGE, lw=1.2, transform=frame, zorder=1))
        axes.add_patch(Rectangle((-RAIL, end), 2 * RAIL, 5, fc=EDGE, ec=EDGE, lw=1.2, transform=frame, zorder=2))
        colour = COLOURS[side]
        self._rod, = axes.plot([], [], color=METAL, lw=4.5, solid_capstyle="round", transform=frame, zorder=5)
        self._spring, = axes.plot([], [], color=DARK, lw=1.2, solid_joinstyle="round", transform=frame, zorder=4)
        self._buffer, = axes.plot([], [], color=DARK, lw=1.6, transform=frame, zorder=3)
        self._block = axes.add_patch(Rectangle((-9, 0), 18, 8, fc=METAL, ec=DARK, lw=1.0, transform=frame, zorder=6))
        self._mass = axes.add_patch(FancyBboxPatch((-11, 0), 22, MASS_HEIGHT, boxstyle="round,pad=0,rounding_size=2.5",
                                                   fc=colour, ec="white", lw=0.8, transform=frame, zorder=6))
        self._plate = axes.add_patch(Rectangle((-12, 0), 24, 4, fc=DARK, ec=DARK, lw=0.8, transform=frame, zorder=5))
        self._glow = [axes.add_patch(Circle((0, 0), size, fc=FLASH, ec="none", alpha=0.0, transform=frame, zorder=4))
                      for size in (11, 17, 24)]

    def show(self, state: Samples, glow: float) -> None:
        """Move the parts to `state`, and set the brightness of the plate."""
        angle, radius = state.crank_angle - self._angle, self._slider.radius * MM
        slider = float(self._slider.position(state.crank_angle)) * MM
        mass = getattr(state, f"{self.side}_position") * MM + FREE_LENGTH
        plate = max(getattr(state, f"{self.side}_plate_position") * MM + FREE_LENGTH, mass) + MASS_HEIGHT
        self._rod.set_data([-radius * math.sin(angle), 0], [radius * math.cos(angle), slider])
        self._block.set_y(slider - 4)
        self._spring.set_data(*_coil(slider + 4, mass, 6, 6.5))
        self._mass.set_y(mass)
        self._plate.set_y(plate)
        self._plate.set_facecolor(FLASH if glow > 0.25 else DARK)
        self._buffer.set_data(*_coil(plate + 4, self._end, 2, 8))
        for patch in self._glow:
            patch.set_center((0, plate))
            patch.set_alpha(0.3 * glow)


def legend(scene: Scene) -> list[Artist]:
    """Return the handles of a legend of the parts."""
    masses = [Patch(fc=COLOURS[side], ec="white", label=f"{side} mass") for side in scene.guides]
    return [
        Patch(fc=BODY, ec=EDGE, label="body with its guides"),
        Line2D([], [], color=DARK, lw=4, label="crank"),
        Line2D([], [], color=METAL, lw=4, label="connecting rod, slider"),
        Line2D([], [], color=DARK, lw=1.2, marker=(2, 0, 45), ms=5, label="spring"),
        *masses,
        Patch(fc=DARK, ec=DARK, label="plate on its spring"),
        Line2D([], [], color="none", marker="o", ms=9, mfc=FLASH, mec="none",
               label="flash: contact, with its\npeak force"),
        Line2D([], [], color="none", marker="$φ$", ms=8, mfc=DARK, mec=DARK, mew=0.2,
               label=f"angle of the inclined\nguide, {math.degrees(scene['guide.angle']):.0f}°"),
    ]


def _coil(start: float, end: float, turns: int, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of a spring along y from start to end."""
    lead = 0.08 * (end - start)
    y = np.concatenate([[start], np.linspace(start + lead, end - lead, 2 * turns + 1), [end]])
    x = np.zeros(len(y))
    x[2:-2:2], x[3:-2:2] = width, -width
    return x, y
