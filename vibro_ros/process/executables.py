"""The one list of executables: setup.py installs them by it, the front door starts them, documents and tests name them.

setup.py runs this file before anything is installed, so the file imports nothing but the standard library.
"""

from collections import namedtuple

Executable = namedtuple("Executable", ["module", "installed", "does"])
Executable.__doc__ = """One executable.

Attributes
----------
module : str
    Module whose `main` takes the words of the command line and returns the exit code.
installed : bool
    Whether `ros2 run vibro_ros NAME` and `.venv/bin/NAME` start it; `python -m MODULE` starts every one.
does : str
    What it does, in one sentence: the first of its `--help`.
"""

EXECUTABLES = {
    "robot": Executable(
        "vibro_ros.ros.robot.robot", True,
        "Run the vibro-impact robot as a ROS 2 device, until SIGINT, SIGTERM or SIGHUP."),
    "controller": Executable(
        "vibro_ros.ros.controller.controller", True,
        "Play a script of commands to the robot."),
    "report": Executable(
        "vibro_ros.recordings.report", True,
        "Sum up a recording of the robot as text and JSON, and draw its motion."),
    "replay": Executable(
        "vibro_ros.recordings.replay", True,
        "Simulate a recorded run again and compare it to the last bit, or vary it, or play it to ROS."),
    "view": Executable(
        "vibro_ros.view.view", True,
        "Show the robot in the browser: a recording as one HTML file, or a live robot with its knobs."),
    "recover": Executable(
        "vibro_ros.recordings.recover", True,
        "Seal bags whose recorder was killed or ran out of disk, or that were damaged since."),
    "accuracy": Executable(
        "vibro_ros.accuracy.accuracy", True,
        "Measure error over cost for every method, as a table and a diagram for each scene."),
    "study": Executable(
        "vibro_ros.study.study", True,
        "Study the machine: the paper's claims, sweeps, the optimum, the literature."),
    "playback": Executable(
        "vibro_ros.ros.controller.playback", False,
        "Play a bag's commands to a live robot, at the instants at which the recorded one took them."),
    "live_view": Executable(
        "vibro_ros.ros.live.live_view", False,
        "Show a live robot in the browser, with its knobs and buttons, until SIGINT, SIGTERM or SIGHUP."),
    "lateness": Executable(
        "tools.lateness", False,
        "Measure how late the robot's ticks are with recording and without, in turn."),
    "view_lateness": Executable(
        "tools.view_lateness", False,
        "Measure how late the robot's ticks are with pages of the live view open and without, in turn."),
    "tick_cost": Executable(
        "tools.tick_cost", False,
        "Measure what a tick of the robot's node costs."),
    "node_cost": Executable(
        "tools.node_cost", False,
        "Measure the processor time of the whole robot against a bare rclpy node that publishes as much."),
    "load": Executable(
        "tools.load", False,
        "Measure what a flood of commands, many listeners and many robots do to rates, memory and delays."),
    "bare_node": Executable(
        "tools.bare_node", False,
        "Publish messages that lie ready, as large as the robot's, and do nothing else."),
    "goal_accuracy": Executable(
        "tools.goal_accuracy", False,
        "Measure how well the controller's feedback holds speeds and reaches positions, in simulated time."),
    "start_time": Executable(
        "tools.start_time", False,
        "Measure how long robot and Python take to start, with an empty cache of kernels and a full one."),
    "coverage": Executable(
        "tools.coverage", False,
        "Count how often intervals of mean speeds hold."),
    "demo": Executable(
        "tools.demo", False,
        "Run the robot and its controller as two processes, record a bag, write a report."),
    "look": Executable(
        "tools.look", False,
        "Run a robot that crawls and its page in the browser as two processes, until Ctrl-C."),
    "bench": Executable(
        "tools.bench", False,
        "Compare the exact solver's cost with fixed-step Runge-Kutta 4 and heyoka."),
    "interface_types": Executable(
        "tools.interfaces.command", False,
        "Build the Python types of ROS packages that PyPI lacks into an environment."),
    "lint": Executable(
        "tools.lint", False,
        "Find slips in documents and docstrings: names and links that lead nowhere, missing units."),
    "accuracy_report": Executable(
        "tools.accuracy_report", False,
        "Measure every shipped scene and write accuracy.md with its diagrams; a quarter of an hour."),
    "paper_report": Executable(
        "research.paper.report", False,
        "Run every claim of the paper under each reading and write paper.md; a quarter of an hour."),
    "literature_report": Executable(
        "research.literature.report", False,
        "Hold published results of other machines against the model and write literature.md; four minutes."),
    "optimum_report": Executable(
        "research.optimum.report", False,
        "Search for the fastest and the thriftiest robots and write optimum.md; half an hour."),
    "effects": Executable(
        "tools.effects", False,
        "Write the tables of effects into a Markdown file."),
    "effect_cost": Executable(
        "tools.effect_cost", False,
        "Measure what effects cost, as ratios of runs with them and without, in turn."),
    "study_cost": Executable(
        "tools.study_cost", False,
        "Measure what a sweep's run costs in time and bytes, and how much faster all cores are than one."),
    "parameter_table": Executable(
        "tools.parameter_table", False,
        "Write the parameters' table into a Markdown file."),
    "urdf_files": Executable(
        "tools.urdf_files", False,
        "Write the robots of scenes as URDF files, by default those of all shipped scenes into config/urdf."),
    "drawing": Executable(
        "tools.drawing", False,
        "Draw the robot with the names of its parts as SVG."),
    "animation": Executable(
        "tools.animation", False,
        "Draw the robot in slow motion as an animated GIF."),
    "screenshot": Executable(
        "tools.screenshot", False,
        "Take pictures of the live view in a real browser: live, and in slow motion at a blow."),
    "view_load": Executable(
        "tools.view_load", False,
        "Measure with real browsers what the live view takes of memory in minutes, and of the robot's clock."),
    "work_weights": Executable(
        "tools.work_weights", False,
        "Measure the weights of counted work, and print counted beside measured costs; a minute."),
}
"""Every executable by its name; those that are installed first."""
