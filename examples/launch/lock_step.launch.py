"""A robot that waits for its controller at each sample, so that two runs have equal bags.

ros2 launch vibro_ros lock_step.launch.py
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessIO
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    """Return the robot, paused, and its controller; robot time begins when the script has begun, and ends with it."""
    robot = Node(package="vibro_ros", executable="robot", output="screen", parameters=[{
        "clock.publish": True, "clock.lock_step": ["/vibro_controller"], "rate.start_paused": True,
        "rate.real_time_factor": 0.0}])
    controller = Node(package="vibro_ros", executable="controller", output="screen",
                      arguments=[LaunchConfiguration("script")], parameters=[{"use_sim_time": True}],
                      on_exit=Shutdown())
    begun = False

    def resume(event):
        nonlocal begun
        if begun or b"entry 1" not in event.text:
            return None
        begun = True
        return ExecuteProcess(cmd=["ros2", "service", "call", "/vibro_robot/pause", "std_srvs/srv/SetBool",
                                   "{data: false}"], output="screen")

    return LaunchDescription([
        DeclareLaunchArgument("script", default_value="crawl", description="a shipped script's name, or a file"),
        robot, controller, RegisterEventHandler(OnProcessIO(target_action=controller, on_stderr=resume))])
