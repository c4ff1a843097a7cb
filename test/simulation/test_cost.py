"""What a run costs, in segments and bytes rather than in seconds: linear in simulated time and in its events."""

import tracemalloc

import numpy as np
import pytest

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.model.tables import compile_scene

EVENTLESS = {"effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.friction": "none"}


def driven(name):
    made = vibro_ros.Simulator(vibro_ros.load_scene(name))
    made.command(motor_speed=100.0)
    return made


@pytest.mark.parametrize("name", shipped_scenes())
def test_segments_and_events_grow_linearly_with_time_and_an_event_costs_a_few(name):
    """From 22 s to 102 s there are four times as many as from 2 s to 22 s, when the start is over, within 5 %: the
    loss-free scenes are chaotic, and their number of events a second wanders by some percent.

    A turn is twice as many segments as the sliders' table has cells; with a dc motor, a sample of its controller and
    an eighth of a radian each begin one more. All others are owed to events: a contact, which is one, has two changes
    of mode and a few short segments between them."""
    made, steps, events, angles = driven(name), [], [], []
    for time in (2.0, 22.0, 102.0):
        made.advance_to(time)
        steps.append(made.statistics["steps"])
        events.append(len(made.take_events()))
        angles.append(made.state.crank_angle)
    np.testing.assert_allclose(steps[2] - steps[1], 4 * (steps[1] - steps[0]), rtol=0.05)
    np.testing.assert_allclose(events[2], 4 * events[1], rtol=0.05)
    turns = (angles[1] - angles[0]) / (2.0 * np.pi)
    of_turn = 2 * len(compile_scene(made.scene).system.signals.series)
    if made.scene.has_rotor:
        of_turn = 50 + 20.0 * made.scene["motor.control_rate"] / turns
    assert steps[1] - steps[0] <= of_turn * (turns + 1.0) + 2 * events[1]


def test_a_turn_without_contacts_has_one_segment_for_each_cell():
    """At a constant speed, where no contact changes the flow, a segment is a whole cell of the sliders' table."""
    made = driven("no_impact")
    cells = len(compile_scene(made.scene).system.signals.series)
    made.advance_to(2.0)
    steps, angle = made.statistics["steps"], made.state.crank_angle
    made.advance_to(12.0)
    turns = (made.state.crank_angle - angle) / (2.0 * np.pi)
    assert made.statistics["steps"] - steps <= cells * turns + 1.0


def peak_memory(function):
    """Return the largest memory [bytes] that a call uses at a time."""
    tracemalloc.start()
    try:
        function()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_time():
    """A run of 1000 s that is sampled once and has no events takes the memory of a run of 10 s. The run is made in one
    part, because a busy machine makes more parts, and Python keeps some objects of each part for the next ones.
    """
    scene = vibro_ros.load_scene("unilateral").with_parameters(EVENTLESS)
    vibro_ros.simulate(scene, times=np.array([1.0]))
    short, long = (peak_memory(lambda time=time: vibro_ros.Simulator(scene).sample(np.array([time])))
                   for time in (10.0, 1000.0))
    assert vibro_ros.simulate(scene, times=np.array([1000.0])).statistics["steps"] > 60_000
    assert long < short + 4096  # bytes: nothing that is proportional to 990 s, 64 000 segments or 16 000 turns


def test_a_simulator_keeps_events_until_they_are_taken_and_not_after():
    made = driven("damped")
    made.advance_to(1.0)
    made.take_events()
    tracemalloc.start()
    try:
        made.advance_to(101.0)
        kept = tracemalloc.get_traced_memory()[0]
        count = len(made.take_events())
        left = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert count > 20_000
    assert 5 * 8 * count <= kept < 6 * 8 * count  # five numbers each
    assert left < 20_000  # bytes
