"""The live view of a robot in the browser: its subscriptions, and the requests of its pages to the robot.

In come the robot's samples, taken from DDS 30 times a second as rows of one run, its contacts, diagnostics, operations
and log (`robot.py`); its parameters (`ros/node/robot_parameters.py`); and the requests of pages.

Out go rows and texts to the pages by `view/server.py`, commands (`commands.py`, which is also the dead man's switch)
and service calls to the robot. Read `view.py` first: the executable, and `LivePage`, which connects all of these. All
of it runs in one thread, except the server and slow motion.
"""
