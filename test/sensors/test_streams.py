"""Counter-based random numbers: Random123's known answers, and each number depends only on its position."""

import numpy as np
import pytest
from scipy import stats

from vibro_ros.sensors.noise import BLOCK, BlockNumbers, Stream, philox

ONES = (1 << 64) - 1
PI = [0x243F6A8885A308D3, 0x13198A2E03707344, 0xA4093822299F31D0, 0x082EFA98EC4E6C89,
      0x452821E638D01377, 0xBE5466CF34E90C6C]


def joined(words: list[int]) -> int:
    return sum(word << 64 * place for place, word in enumerate(words))


@pytest.mark.parametrize("words, answer", [
    ([0] * 6, "16554d9eca36314c db20fe9d672d0fdc d7e772cee186176b 7e68b68aec7ba23b"),
    ([ONES] * 6, "87b092c3013fe90b 438c3c67be8d0224 9cc7d7c69cd777b6 a09caebf594f0ba0"),
    (PI, "a528f45403e61d95 38c72dbd566e9788 a5a1610e72fd18b5 57bd43b5e52b7fe6")])
def test_random123s_known_answers(words, answer):
    """A60."""
    assert [f"{word:016x}" for word in philox(joined(words[4:]), joined(words[:4]), 1)[0]] == answer.split()


def test_a_sample_does_not_depend_on_earlier_reads():
    forwards, jumping = BlockNumbers(Stream(3, "a").walk), BlockNumbers(Stream(3, "a").walk)
    indices = [0, 1, BLOCK - 1, BLOCK, 5 * BLOCK + 7, 2 * BLOCK]
    assert [jumping[index] for index in reversed(indices)] == [forwards[index] for index in indices][::-1]
    normal = np.vstack([Stream(3, "a").normal(block) for block in range(6)])
    walk = np.zeros(4)
    for row in normal[:5 * BLOCK + 7]:
        walk = walk + row
    assert forwards[5 * BLOCK + 7] == walk.tolist()


def test_streams_differ_by_seed_and_by_name():
    streams = [Stream(seed, name).uniform(0) for seed in (0, 1) for name in ("imu", "encoder")]
    assert all(abs(np.corrcoef(stream.ravel(), other.ravel())[0, 1]) < 0.1  # 4.5 standard errors of 2048 pairs
               for k, stream in enumerate(streams) for other in streams[:k])


def test_the_normal_numbers_are_normal():
    numbers = np.vstack([Stream(11, "noise").normal(block) for block in range(50)])
    assert stats.kstest(numbers.ravel(), "norm").pvalue > 1e-3
    lag = numbers.ravel()
    assert abs(np.mean(lag[1:] * lag[:-1])) < 5.0 / np.sqrt(lag.size)
