"""The page in the browser: what it draws, of a live robot and of a recording. No rclpy here.

Of a recording (`view.py`): `recorded.py` reads the samples and inputs of a bag; `exact.py` walks a device from sample
to sample and keeps the intervals in which it reaches them; `bag_motion.py` puts these and what is interpolated
together; `motion.py` fits polynomials to them and writes the motion document; `page.py` makes one HTML file of it.

Of a live robot: the room `ros.live` hands rows of samples to `server.py`, which serves the page and its web socket;
`protocol.py` says what page and server send each other; `slow_motion.py` computes the last seconds between samples.

`drawing.py` says what a page needs to know of a scene to draw it. The folder `page` holds the page itself: begin with
`main.js`, then `page.js` (the loop and the picture), `live.js` and `motion.js`.
"""
