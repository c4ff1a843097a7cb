"""Slow motions, computed in a thread of their own, so that the page goes on meanwhile.

The kernels that compute them are compiled, or loaded, before the first one; that begins when the first robot is there,
because a robot that has just been started on this machine has compiled the same ones, and one compilation is enough.
"""

import threading
from collections.abc import Callable, Mapping
from queue import Full, Queue
from typing import Any

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.simulation.preparation import Preparation

MOST_WAITING = 8
"""Motions that wait for those before them: one for each page."""

Motion = Callable[[Scene, Mapping[str, np.ndarray]], tuple[dict[str, Any], bytes]]
"""Computes the motion of a scene between samples: header and payload; ValueError says in words why it cannot."""
Done = Callable[[tuple[dict[str, Any], bytes] | str], object]
"""Is given the motion, or in words why there is none; called in the thread."""


class SlowMotions:
    """Computes one motion after the other.

    Parameters
    ----------
    compute : callable
        Computes a motion.
    tell : callable
        Is given lines for people while kernels are compiled.
    """

    def __init__(self, compute: Motion, tell: Callable[[str], object]):
        self._compute, self._tell = compute, tell
        self._preparation: Preparation[None] | None = None
        self._line: Queue[tuple[Scene, Mapping[str, np.ndarray], Done]] = Queue(MOST_WAITING)

    def prepare(self, method: str) -> None:
        """Begin to compile what a `solver.method` needs, if that has not begun."""
        if self._preparation is None:
            self._preparation = Preparation(lambda: compile_kernels(method), self._tell)
            threading.Thread(target=self._work, name="slow motion", daemon=True).start()

    def watch(self) -> None:
        """Say how far the compilation is, if that is due; to be called often."""
        if self._preparation:
            self._preparation.done()

    def ask(self, scene: Scene, samples: Mapping[str, np.ndarray], done: Done) -> None:
        """Compute the motion between samples; whatever comes of it is `done`'s."""
        if self._preparation is None or not self._preparation.done():
            done("slow motion is being prepared; ask again in some seconds")
            return
        if len(samples["time"]) < 2:
            done("there are no samples of the last seconds; let the robot run")
            return
        try:
            self._line.put_nowait((scene, samples, done))
        except Full:
            done(f"{MOST_WAITING} slow motions wait already; ask again later")

    def _work(self) -> None:
        while True:
            scene, samples, done = self._line.get()
            try:
                done(self._compute(scene, samples))
            except Exception as error:  # a page's wish ends nothing; the words say what was wrong
                done(f"there is no slow motion of these samples: {type(error).__name__}: {error}")
