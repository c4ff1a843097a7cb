"""The live view of a robot in the browser: what it hears, and what it asks.

What comes in: the robot's samples, taken from DDS 30 times a second as rows of one run (`robot.py`); its contacts,
diagnostics, operations and log (`status.py`); its parameters (`ros/node/robot_parameters.py`); and the requests of
pages.

What goes out: rows and texts to the pages by `view/server.py`, commands (`commands.py`, which is also the dead man's
switch) and calls of services to the robot (`page.py`, where everything meets: begin there). `view.py` is the
executable. All of it runs in one thread, but for the server's and for slow motion.
"""
