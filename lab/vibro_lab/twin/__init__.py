"""The twin executable: follows a robot by its sensors and commands, and says when it leaves the model.

In come the topics of a robot; out go an estimate of its motion and parameters, and a fault by name. Read `twin.py`
first: it starts the node and runs its loop. `messages.py` turns messages of any peer into measurements and commands, or
refuses them, and publishes. What they are made of, the estimator, is `estimator.py`, whose particles are in
`particles.py`, both without ROS.
"""
