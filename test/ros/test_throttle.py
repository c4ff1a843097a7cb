from vibro_ros.ros.node.throttle import Throttle


def test_a_burst_passes_then_one_a_period_with_the_number_withheld():
    now = 0.0
    throttle = Throttle(burst=3, period=1.0, now=lambda: now)
    assert [throttle.admit("hot") for _ in range(5)] == ["hot", "hot", "hot", None, None]
    now = 0.9
    assert throttle.admit("hot") is None
    now = 1.0
    assert throttle.admit("hot") == "hot (3 more like it not shown)"
    assert throttle.admit("hot") is None


def test_silence_earns_no_more_than_the_burst():
    now = 0.0
    throttle = Throttle(burst=2, period=1.0, now=lambda: now)
    now = 1000.0
    assert [throttle.admit("hot") for _ in range(3)] == ["hot", "hot", None]
