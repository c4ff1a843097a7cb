"""A Gymnasium environment over the device and its sensors; importing this room registers it.

In come actions of a policy, motor speed and gaps; out go observations by encoder and tracking, and a reward.
`crawl.py` is all of it: its class is the manual page. It needs gymnasium, and no ROS.
"""

import gymnasium

gymnasium.register("vibro_ros/Crawl-v1", entry_point="vibro_ros.gym.crawl:Crawl", max_episode_steps=100)
