"""Bags that a killed robot has left, looked for when the next one starts."""

from pathlib import Path

from rclpy.impl.rcutils_logger import RcutilsLogger

from vibro_ros.bag.folders import BAG_PATTERN, unsealed_bags
from vibro_ros.bag.recovery import RecoveryError, described, recover
from vibro_ros.process.untrusted import one_line

MOST_UNSEALED = 10
"""Unsealed bags that are named at the start; how many more there are is said."""


def offer_recovery(directory: Path, do_it: bool, log: RcutilsLogger) -> None:
    """Say which bags in `directory` a killed robot has left unsealed, and seal them if told to `do_it`."""
    unsealed = unsealed_bags(directory, BAG_PATTERN)
    if not do_it:
        for folder in unsealed[:MOST_UNSEALED]:
            name = one_line(folder)
            log.warning(f"{name}: not sealed, its robot was killed; seal it with `recover {name}`")
        if len(unsealed) > MOST_UNSEALED:
            log.warning(f"{directory}: {len(unsealed) - MOST_UNSEALED} more bags are not sealed")
        return
    for folder in unsealed:
        try:
            log.warning("; ".join(described(recover(folder), str)))
        except RecoveryError as error:
            log.error(str(error))
