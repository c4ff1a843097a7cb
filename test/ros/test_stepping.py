"""The stepping thread on real topics, where a process of its own cannot be made to fail."""

import vibro_ros
from vibro_ros.ros.inputs import Inputs
from vibro_ros.ros.outputs import Outputs
from vibro_ros.ros.pacing import Pacing
from vibro_ros.ros.stepping import Stepping


def test_an_error_ends_the_thread_and_is_kept_for_the_main_thread(bench):
    scene = vibro_ros.load_scene("device")
    device, stamps = vibro_ros.Simulator(scene), []

    def record(topic: str, stamp: int, data: bytes) -> None:
        stamps.append(stamp)
        if stamp == 1_000 + 10_000_000:
            raise RuntimeError("third sample")

    pacing = Pacing(factor=0.0, max_catch_up=0.1)
    stepping = Stepping(device, Inputs(bench.node), Outputs(bench.node, scene), record, pacing, rate=200.0, start=1_000,
                        log=bench.node.get_logger())
    with stepping:
        bench.spin_until(lambda: stepping.error is not None, "the error")
    assert str(stepping.error) == "third sample"
    assert sorted(set(stamps)) == [1_000, 1_000 + 5_000_000, 1_000 + 10_000_000]
    assert device.time == 0.01
    assert len(device.take_events()) == 0  # each tick took what had come, so that a long run keeps none
