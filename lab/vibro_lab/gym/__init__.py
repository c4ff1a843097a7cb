"""A Gymnasium environment over the device and its sensors; importing this room registers it.

In come the actions of a policy, motor speed and gaps; out go observations from encoder and tracking, and a reward.
`crawl.py` is all of it; the docstring of its class is the manual page. It needs gymnasium, and no ROS.
"""

import gymnasium

gymnasium.register("vibro_lab/Crawl-v1", entry_point="vibro_lab.gym.crawl:Crawl", max_episode_steps=100)
