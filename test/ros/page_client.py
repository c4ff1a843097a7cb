"""A page of the live view without a browser, which reads in a thread of its own."""

import json
import threading
import time
from collections.abc import Callable

import numpy as np
from web_client import TEXT, Address

from vibro_ros.view.protocol import COLUMNS

PATIENCE = 60.0  # [s] deadline of what takes a second on an idle machine


class PageClient:
    """Connects as the page does, keeps what it is sent, and asks.

    `texts` are the text frames, `rows` the samples, each of shape (n, len(COLUMNS)), `motions` the payloads by id.
    """

    def __init__(self, address: Address):
        self.texts: list[dict] = []
        self.rows: list[np.ndarray] = []
        self.motions: dict[int, bytes] = {}
        self.closed = False
        self._web_socket, self._asked = address.web_socket(), 0
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def ask(self, **request: object) -> dict:
        """Send a request and return its answer."""
        self._asked += 1
        id = self._asked
        self._web_socket.send({"id": id, **request})
        return self.wait(lambda: next((text for text in list(self.texts) if text.get("id") == id), None), f"{request}")

    def last(self, *kinds: str) -> dict:
        """Return the last text frame of these kinds, or None."""
        return next((text for text in reversed(list(self.texts)) if text["kind"] in kinds), {})

    def wait(self, condition: Callable[[], object], description: str, patience: float = PATIENCE):
        """Wait until the result of `condition` is true, and return the result."""
        deadline = time.monotonic() + patience
        while not (result := condition()):
            assert time.monotonic() < deadline, f"{description}: not within {patience} s; last: {self.texts[-3:]}"
            time.sleep(0.01)
        return result

    def wait_for_robot(self, **fields: object) -> dict:
        """Wait until the last status frame is `robot`, with an origin and these fields, and return it."""
        def robot() -> dict | None:
            frame = self.last("robot", "absent")
            return frame if frame.get("kind") == "robot" and frame["origin"] != "0" and all(
                frame[name] == value for name, value in fields.items()) else None
        return self.wait(robot, f"a robot with {fields}")

    def wait_for_absence(self, words: str) -> str:
        """Wait until the last status frame says that there is no robot, with these `words`, and return its text."""
        def absence() -> str | None:
            frame = self.last("robot", "absent")
            return frame["words"] if frame.get("kind") == "absent" and words in frame["words"] else None
        return self.wait(absence, f"absence for {words!r}")

    def wait_for_rows(self, count: int) -> np.ndarray:
        """Wait for so many more rows."""
        begin = len(self.rows)
        self.wait(lambda: sum(map(len, self.rows[begin:])) >= count, f"{count} rows")
        return np.concatenate(self.rows[begin:])

    def close(self) -> None:
        """End the connection."""
        self._web_socket.end()
        self._thread.join()

    def _listen(self) -> None:
        with self._web_socket:
            while (frame := self._web_socket.receive(3600.0)) is not None:
                self._take(*frame)
        self.closed = True

    def _take(self, opcode: int, frame: bytes) -> None:
        if opcode == TEXT:
            self.texts.append(json.loads(frame))
            return
        kind, number = np.frombuffer(frame[:8], "<u4").tolist()
        if kind == 1:
            self.rows.append(np.frombuffer(frame, "<f8", offset=8).reshape(number, len(COLUMNS)))
        else:
            self.motions[number] = frame[8:]
