"""The page in the browser, for a live robot and for a recording. No rclpy here.

In comes a bag, and out goes one HTML file (`view.py`, read first): `recorded.py` reads the samples and inputs of a bag;
`exact.py` simulates the recorded run again and keeps the intervals in which it reaches the samples;
`view.py:bag_motion` joins these and the interpolated rest; `motion.py` fits polynomials and writes the motion document;
`page.py` makes the HTML file.

For a live robot, the room `ros.live` passes rows of samples to `server.py`, which serves the page and its web socket;
`protocol.py` defines what page and server send each other, with the dimensions and commands of a scene that a page
draws; `slow_motion.py` keeps the samples of the last seconds, and interpolates between them.

The folder `page` has the page itself: begin with `main.js`, then `page.js` (the loop and the picture), `live.js` and
`motion.js`.
"""
