"""A Gymnasium environment over the device and its sensors; importing this room registers it."""

import gymnasium

gymnasium.register("vibro_ros/Crawl-v1", entry_point="vibro_ros.gym.crawl:Crawl", max_episode_steps=100)
