"""Scripts, from YAML text to commands in time."""

from pathlib import Path

import pytest

from vibro_ros.configuration.scene_file import find_file
from vibro_ros.ros.controller.feedback import PositionGoal, SpeedGoal, check_reach
from vibro_ros.ros.controller.script import read_script


def script(folder: Path, text: str):
    path = folder / "script.yaml"
    path.write_text(text)
    return read_script(path)


def test_holds_follow_each_other_and_stay_until_changed(tmp_path):
    played = script(tmp_path, """
entries:
  - {for: 2.0, motor_speed: 100, upper_gap: 1e-3}
  - {for: 3.0, motor_speed: 50.0}
""")
    assert played.duration == 5.0
    assert played.commands == ("motor_speed", "upper_gap")
    assert played.command_at(0.0) == {"motor_speed": 100.0, "upper_gap": 0.001}
    assert played.command_at(1.999) == {"motor_speed": 100.0, "upper_gap": 0.001}
    assert played.command_at(2.0) == {"motor_speed": 50.0, "upper_gap": 0.001}
    assert played.command_at(99.0) == {"motor_speed": 50.0, "upper_gap": 0.001}
    assert instants_of(played, 50.0) == [0.0, 2.0]


def instants_of(played, rate: float) -> list[float]:
    """Return the instants [s] at which commands change."""
    return [instant for segment in played.segments for instant in segment.instants(rate)]


def test_a_ramp_is_a_straight_line_that_reaches_its_end(tmp_path):
    played = script(tmp_path, """
entries:
  - {for: 2.0, motor_speed: {from: 10.0, to: 30.0}}
  - {for: 1.0, motor_speed: {to: 0.0}}
""")
    speeds = [played.command_at(time)["motor_speed"] for time in (0.0, 0.5, 1.0, 2.0, 2.5, 3.0)]
    assert speeds == [10.0, 15.0, 20.0, 30.0, 15.0, 0.0]
    assert instants_of(played, 2.0) == [0.0, 0.5, 1.0, 1.5, 2.0, 2.0, 2.5, 3.0]


def test_at_sets_the_start_of_an_entry_and_the_end_of_the_previous_one(tmp_path):
    played = script(tmp_path, """
entries:
  - {at: 1.0, motor_speed: 10.0}
  - {at: 4.0, for: 1.0, motor_speed: 20.0}
  - {at: 7.0, for: 1.0, motor_speed: 30.0}
""")
    assert [(segment.start, segment.duration) for segment in played.segments] == [(1.0, 3.0), (4.0, 1.0), (7.0, 1.0)]
    assert played.command_at(0.5) == {}
    assert played.command_at(6.0) == {"motor_speed": 20.0}  # held over the pause


def test_blocks_repeat_on_their_own_clock(tmp_path):
    played = script(tmp_path, """
repeat: 2
entries:
  - {for: 1.0, motor_speed: 5.0}
  - repeat: 3
    entries:
      - {at: 0.0, motor_speed: 10.0}
      - {at: 0.5, for: 0.5, motor_speed: {to: 20.0}}
""")
    assert played.duration == 8.0
    assert [segment.entry for segment in played.segments] == ["1", *["2.1", "2.2"] * 3] * 2
    once = [0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5]
    assert [segment.start for segment in played.segments] == [*once, *(4.0 + start for start in once)]
    assert played.command_at(7.75) == {"motor_speed": 15.0}


def test_goals_are_read_with_their_defaults(tmp_path):
    played = script(tmp_path, """
entries:
  - {hold_speed: -0.05, for: 10.0, upper_gap: 0.001, note: steady}
  - {go_to: -0.5, within: 0.002, timeout: 30.0, motor_speed: {to: 80}}
  - {for: 1.0, motor_speed: {to: 50.0}}
""")
    assert played.commands == ("motor_speed", "upper_gap")
    assert played.goals == (("1", SpeedGoal(-0.05, 0.005, (0.0, 100.0))), ("2", PositionGoal(-0.5, 0.002, (0.0, 80.0))))
    assert [(segment.start, segment.duration) for segment in played.segments] == [
        (0.0, 10.0), (10.0, 30.0), (40.0, 1.0)]
    assert played.command_at(5.0) == played.command_at(20.0) == {"upper_gap": 0.001}  # the motor is feedback's
    assert played.command_at(40.5) == {"motor_speed": 25.0, "upper_gap": 0.001}  # from the standstill that go_to leaves
    assert [segment.describe() for segment in played.segments[:2]] == [
        "entry 1, 10 s: hold -0.05 m/s within 0.005 m/s, motor 0 to 100 rad/s, upper_gap 0.001 m (steady)",
        "entry 2, 30 s: go to -0.5 m within 0.002 m, motor 0 to 80 rad/s",
    ]


def test_entries_after_a_position_may_be_placed_in_a_list_of_their_own(tmp_path):
    played = script(tmp_path, """
entries:
  - {at: 1.0, go_to: -0.5, timeout: 5.0}
  - repeat: 2
    entries: [{at: 1.0, for: 1.0, motor_speed: 5.0}, {at: 3.0, hold_speed: -0.01, for: 4.0}]
""")
    assert [segment.start for segment in played.segments] == [1.0, 7.0, 9.0, 14.0, 16.0]


BAD = {
    "two goals": ("entries: [{go_to: 1.0, hold_speed: 1.0, for: 9.0}]\n",
                  "entry 1: hold_speed and go_to: one entry has one goal; make two entries of it"),
    "no timeout": ("entries: [{go_to: 1.0}]\n", "entry 1: go_to: no longest time; give `timeout: <seconds>`"),
    "hold too short": ("entries: [{hold_speed: 1.0, for: 3.9}]\n",
                       "entry 1: hold_speed: 3.9 s is too short to settle and to be measured; give at least 4 s"),
    "goal and speed": ("entries: [{go_to: 1.0, timeout: 9.0, motor_speed: 50.0}]\n",
                       "entry 1: motor_speed: 50.0 is no range; beside a goal give the range that feedback uses"),
    "empty range": ("entries: [{go_to: 1.0, timeout: 9.0, motor_speed: {from: 50, to: 50}}]\n",
                    "entry 1: motor_speed: from 50 to 50 rad/s is no range; give `to` above `from`"),
    "at after go_to": ("entries: [{go_to: 1.0, timeout: 9.0}, {for: 1.0}, {at: 20.0, for: 1.0}]\n",
                       "entry 3: at: when the go_to before it in this list ends is not known; leave `at` out, or put"),
    "ramp after hold": ("entries: [{hold_speed: 1.0, for: 9.0}, {for: 1.0, motor_speed: {to: 9.0}}]\n",
                        "entry 2: motor_speed: no value to start the ramp from; give `from`"),
    "empty": ("", "the file is empty"),
    "a list": ("- {for: 1.0}\n", "is not a mapping; give `entries`"),
    "no duration": ("entries: [{motor_speed: 1.0}]\n", "entry 1: no duration; give `for: <seconds>`"),
    "negative time": ("entries: [{at: -1.0, for: 1.0}]\n", "entry 1: at: -1 is negative; give a time of at least 0 s"),
    "backwards": ("entries: [{for: 3.0}, {at: 2.0, for: 1.0}]\n",
                  "entry 2: at: 2 s lies before the end of the entry before"),
    "no time left": ("entries: [{at: 2.0}, {at: 2.0, for: 1.0}]\n", "entry 1: at of the next entry: leaves 0 s"),
    "NaN": ("entries: [{for: 1.0, motor_speed: .nan}]\n",
            "entry 1: motor_speed: nan is not finite; give a number in rad/s"),
    "unknown key": ("entries: [{for: 1.0, motor_sped: 1.0}]\n", "entry 1: motor_sped: unknown key; give at, for, note, "
                    "fault, of, value, from_x, to_x, motor_speed, upper_gap, inclined_gap, "
                    "motor_voltage, hold_speed, go_to; did you mean motor_speed?"),
    "ramp without end": ("entries: [{for: 1.0, motor_speed: {from: 1.0}}]\n",
                         "entry 1: motor_speed: a ramp needs `to`"),
    "ramp from nowhere": ("entries: [{for: 1.0, motor_speed: {to: 1.0}}]\n",
                          "no value to start the ramp from; give `from`"),
    "repeat half": ("repeat: 0.5\nentries: [{for: 1.0}]\n",
                    "repeat: 0.5 is not a count; give a whole number of at least 1"),
    "inside a block": ("entries: [{for: 1.0}, {entries: [{for: 1.0}, {for: x}]}]\n",
                       "entry 2.2: for: 'x' is not a number"),
    "too long": ("repeat: 1000\nentries: [{repeat: 1000, entries: [{for: 1.0}]}]\n",
                 "unfolds to more than 100000 entries"),
    "too deep": ("entries: [{" * 12 + "for: 1" + "}]" * 12, "more than 10 blocks inside each other; use fewer"),
    "nothing commanded": ("entries: [{for: 1.0}]\n",
                          "no entry gives a command; give motor_speed, upper_gap, inclined_gap"),
    "no such fault": ("entries: [{for: 1.0, fault: earthquake}]",
                      "entry 1: fault: 'earthquake' is unknown; choose one of motor_stall"),
    "fault of no kind": ("entries: [{for: 1.0, fault: [motor_stall]}]", "entry 1: fault: "),
    "fault of nothing": ("entries: [{for: 1.0, fault: plate_stuck}]",
                         "entry 1: of: '' has no plate_stuck; give upper or inclined"),
    "no fault": ("entries: [{for: 1.0, of: upper}]", "entry 1: of: belongs to a fault; give `fault`"),
    "fault by NaN": ("entries: [{for: 1.0, fault: late_commands, value: .nan}]",
                     "entry 1: value: nan is not finite"),
    "fault and goal": ("entries: [{for: 1.0, fault: motor_stall, hold_speed: 1.0}]", "entry 1: fault: unknown key"),
}


@pytest.mark.parametrize("text, reason", BAD.values(), ids=BAD)
def test_a_bad_script_is_refused_with_file_entry_and_reason(tmp_path, text, reason):
    with pytest.raises(ValueError) as refusal:
        script(tmp_path, text)
    assert str(refusal.value).startswith(str(tmp_path / "script.yaml"))
    assert reason in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_shipped_scripts_drive_and_stop_the_motor_and_their_goals_are_within_reach():
    for name in ("crawl", "pulses"):
        played = read_script(find_file("script", name))
        speeds = [played.command_at(time).get("motor_speed", 0.0) for time in instants_of(played, 10.0)]
        assert max(speeds) >= 100.0  # [rad/s]
        assert played.command_at(played.duration)["motor_speed"] == 0.0
    goals = read_script(find_file("script", "goals")).goals
    assert [type(goal) for _, goal in goals] == [SpeedGoal, PositionGoal]
    check_reach(goals, -0.06)


def test_a_fault_lasts_as_long_as_its_entry(tmp_path):
    played = script(tmp_path, """
entries:
  - {for: 1.0, motor_speed: 100.0}
  - {for: 0.5, fault: plate_stuck, of: upper, upper_gap: 0.001}
  - {for: 0.2, fault: late_commands, value: 0.1}
""")
    assert [segment.incident for segment in played.segments] == [
        None, ("plate_stuck", 0.5, "upper", 0.0, 0.0, 0.0), ("late_commands", 0.2, "", 0.1, 0.0, 0.0)]
    assert played.segments[1].describe() == "entry 2, 0.5 s: upper_gap 0.001 m, fault plate_stuck upper"
