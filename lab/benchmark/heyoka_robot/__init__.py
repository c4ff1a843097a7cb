"""A second robot to compare with: heyoka, a general Taylor integrator with events, and modes written by hand.

The only independent check of the dc motor, of rigid plates with the reaction on the masses, and of Stribeck's friction.
It is written from the equations of docs/robot.md; of this package it uses the parameters of a `Scene`, and neither the
compiled tables nor the solver. It needs the optional extra `bench`. Read in this order:

- `equations`: forces and accelerations as heyoka expressions, with parameters where a mode switches a term;
- `run_state`: the integrator's arrays, parameters by name, events so far;
- `contacts`: what an event of the ground or of a plate does;
- `robot`: `HeyokaRobot`, a run from event to event, and its motors.
"""

from benchmark.heyoka_robot.robot import COLUMNS, DRIVEN, HeyokaRobot, HeyokaRun

__all__ = ["COLUMNS", "DRIVEN", "HeyokaRobot", "HeyokaRun"]
