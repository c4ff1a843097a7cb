"""The pure functions of the page's modules: results are compared with Python's, or with an exact answer."""

import base64
import math

import numpy as np
import pytest
from motion_reader import MotionDocument
from page_reading import Modules

import vibro_ros
from vibro_ros.model.slider import Slider
from vibro_ros.view.motion import MotionWriter
from vibro_ros.view.protocol import drawing

EXACT = 4e-16  # relative: the same operations in another order


@pytest.fixture
def modules(page):
    return Modules(page)


def binary(data: bytes) -> str:
    return base64.b64encode(data).decode()


BUFFER = "const buffer = Uint8Array.from(atob(v[0]), (one) => one.codePointAt(0)).buffer;"


def random_motion(pieces=40, quantities=3, gap_after=20):
    random = np.random.default_rng(5)
    writer = MotionWriter([f"q{k}" for k in range(quantities)], [1e-9, 1e-6, 2.0])
    ends = np.cumsum(random.uniform(1e-4, 1e-2, pieces))
    borders = np.stack([np.concatenate([[0.0], ends[:-1]]), ends], axis=1)
    borders[gap_after:] += 0.5
    coefficients = random.normal(size=(pieces, quantities, 9)) * 0.3 ** np.arange(9)
    coefficients[3:6, 1] = np.nan
    writer.add(borders, coefficients)
    return writer.document({"exact": False, "why": "invented", "exact_spans": [], "impacts": [], "resets": []})


def test_the_motion_reader_agrees_with_the_reader_in_python(modules):
    header, payload = random_motion()
    motion = MotionDocument(header, payload)
    times = np.random.default_rng(6).uniform(*motion.borders[7], 50)
    times = np.concatenate([times, motion.borders[:20].mean(axis=1), motion.borders[:, 0] + 1e-9])
    values = modules.call("motion", BUFFER + """
        const motion = new m.Motion(v[1], buffer);
        return v[2].map((time) => v[1].quantities.map((name) => {
          const value = motion.value(name, time);
          return Number.isNaN(value) ? null : value;
        }));""", binary(payload), header, times.tolist())
    values = np.array([[math.nan if value is None else value for value in row] for row in values])
    expected = np.stack(list(motion.at(times).values()), axis=1)
    np.testing.assert_allclose(values, expected, rtol=1e-13, atol=1e-13)  # sums of 9 numbers of size 1


def test_sliders_stand_where_the_model_has_them(modules):
    psi = np.linspace(-7.0, 7.0, 57)
    for rod in (0.06, 0.02):
        positions = modules.call("mechanism", "return v[1].map((psi) => m.sliderPosition(0.02, v[0], psi));", rod,
                             psi.tolist())
        np.testing.assert_allclose(positions, Slider(0.02, rod, 0.0).position(psi), rtol=EXACT, atol=1e-17)


def test_ticks_are_round(modules):
    for low, high, most, expected in (
            (0.0, 10.0, 5, [0, 2, 4, 6, 8, 10]), (-0.3, 0.3, 3, [-0.2, 0.0, 0.2]),
            (59.9, 60.2, 6, [59.9, 59.95, 60.0, 60.05, 60.1, 60.15, 60.2]),
            (3600.0, 3600.001, 2, [3600.0, 3600.0005, 3600.001])):
        ticks = modules.call("text", "return m.ticks(...v).ticks;", low, high, most)
        assert ticks == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_an_axis_changes_only_when_its_data_no_longer_suit_it(modules):
    first = modules.call("text", "return m.axisRange(null, 1.2, 8.7, 1);")
    assert first == {"low": 0, "high": 10}
    assert modules.call("text", "return m.axisRange(v[0], 2, 9.5, 1);", first) == first
    assert modules.call("text", "return m.axisRange(v[0], 4.9, 5.3, 1);", first) != first
    assert modules.call("text", "return m.axisRange(v[0], -0.1, 9.5, 1).low;", first) < 0


def test_a_sample_buffer_keeps_the_newest_rows(modules):
    rows = [number for k in range(25) for number in (k * 0.1, float(k * k))]
    buffer = modules.call("samples", """
        const samples = new m.SampleBuffer(["time", "square"], 10);
        samples.push(Float64Array.from(v[0].slice(0, 31)));
        samples.push(Float64Array.from(v[0].slice(30)));
        const values = {};
        samples.read(1.95, values);
        const points = [];
        samples.trace("square", 2, 2.4, 1e-3, (time, value) => points.push(value));
        return {count: samples.count, begin: samples.begin, end: samples.end, early: samples.row(0), values, points,
                again: samples.push(Float64Array.from(v[0]))};""", rows)
    assert (buffer["count"], buffer["early"], buffer["again"]) == (10, -1, 0)
    assert (buffer["begin"], buffer["end"]) == (pytest.approx(1.5), pytest.approx(2.4))
    assert buffer["values"] == {"time": pytest.approx(1.9), "square": 361}
    assert buffer["points"] == [400, 441, 484, 529, 576]


def test_the_extremes_of_many_samples_in_a_pixel_are_drawn(modules):
    values = np.random.default_rng(8).normal(size=1000)
    rows = np.stack([np.arange(1000) * 1e-3, values], axis=1).ravel().tolist()
    points = modules.call("samples", """
        const samples = new m.SampleBuffer(["time", "noise"], 1000);
        samples.push(Float64Array.from(v[0]));
        const points = [];
        samples.trace("noise", 0, 1, 0.1, (time, value) => points.push([time, value]));
                          return points;""", rows)
    assert len(points) <= 22
    assert min(value for _, value in points) == values.min() and max(value for _, value in points) == values.max()


TYPED = {
    "4,5": 4.5, " 4.5 ": 4.5, ",5": 0.5, "\u22120,25": -0.25, "1e-3": 1e-3, "45": 45.0, "1,000": 1.0,
    **dict.fromkeys(("4.5.0", "1.234,5", "1,234.5", "1,2,3", "1 000", "0x10", "", "1e999", "Infinity", "\u0664",
                     "4,5 rad/s", "-", "e5"))}


def test_typed_numbers_are_read_exactly_or_refused(modules):
    numbers = modules.call("knobs", """return v[0].map((typed) => {
        const number = m.numberOf(typed);
        return Number.isNaN(number) ? null : number;
        });""", list(TYPED))
    assert dict(zip(TYPED, numbers, strict=True)) == TYPED


def test_csv_has_the_last_rows_with_all_their_digits(modules):
    rows = np.stack([np.arange(100) + 1 / 3, np.random.default_rng(9).normal(size=100), np.zeros(100)], axis=1)
    text = modules.call("samples", """const samples = new m.SampleBuffer(["time", "noise", "absent"], 1000);
        samples.push(Float64Array.from(v[0]));
        return m.csv(samples, ["noise"], 59.5);""", rows.ravel().tolist())
    head, *lines = text.splitlines()
    assert head == "time,noise"
    assert [[float(word) for word in line.split(",")] for line in lines] == rows[-60:, :2].tolist()


def test_the_mean_speed_begins_at_a_reset_and_skips_unknown_spans(modules):
    """Six seconds at 10 mm/s, in the last one with the crank reversed; then a reset, and two at -20 mm/s."""
    times = np.arange(0.0, 8.001, 0.01)
    before_reset = times < 6.0
    rows = np.stack([times, np.where(before_reset, 0.01 * times, -0.02 * (times - 6.0)),
                     np.where(before_reset, 500.0 - 200.0 * abs(times - 5.0), times - 6.0),
                     np.where(before_reset, np.where(times < 5.0, 200.0, -200.0), 1.0)], axis=1)
    call = """const names = ["time", "body_position", "crank_angle", "motor_speed"];
        const samples = new m.SampleBuffer(names, 1000);
        samples.push(Float64Array.from(v[0]));
        const {meanSpeed} = await import("vibro/speed.js");
        return v[1].map((time) => Object.values(meanSpeed(samples, time)));"""
    means = np.array(modules.call("samples", call, rows.ravel().tolist(), [5.99, 8.0, 2.0]))
    np.testing.assert_allclose(means[:, 0], [5.0, 2.0, 2.0], atol=0.02)
    np.testing.assert_allclose(means[:, 1], [0.01, -0.02, 0.01], rtol=1e-9)
    for known in (False, True):  # computed at once, or in pieces that are kept
        curve = modules.call("speed", """const {SampleBuffer} = await import("vibro/samples.js");
            const samples = new SampleBuffer(["time", "body_position", "crank_angle", "motor_speed"], 1000);
            samples.push(Float64Array.from(v[0]));
            const found = new m.SpeedCurve(samples, v[1]).points(5, 7.5);
            return found.map((one) => Number.isNaN(one) ? null : one);""", rows.ravel().tolist(), known)
        at, speed = np.array(curve, dtype=float).reshape(-1, 2).T
        assert at[np.isnan(speed)] == pytest.approx([6.0], abs=0.011)
        assert at.min() <= 5.0 + 0.011 and at.max() >= 7.5 - 0.011
        late = at > 6.05
        np.testing.assert_allclose(speed[late], -0.02, rtol=1e-9)
        np.testing.assert_allclose(speed[~late & ~np.isnan(speed)], 0.01, rtol=1e-9)
        assert at[late].min() == pytest.approx(6.1, abs=0.021)  # a shorter mean would be that of a part of a turn


def test_curve_and_path_follow_the_motion_and_break_at_gaps(modules):
    header, payload = random_motion()
    motion = MotionDocument(header, payload)
    points, curve = modules.call("motion", BUFFER + """
        const [points, curve, motion] = [[], [], new m.Motion(v[1], buffer)];
        motion.path(["q0", "q2"], v[1].begin - 1, v[1].end, 1e-3, (time, values) => {
          points.push([time, ...values.map((one) => Number.isNaN(one) ? null : one)]);
        });
        motion.trace("q0", v[1].begin, v[1].end, 1e-3, (time, value) => {
          curve.push([time, Number.isNaN(value) ? null : value]);
        });
                                 return [points, curve];""", binary(payload), header)
    assert [time for time, value in curve if value is None] == [motion.borders[20, 0]]
    drawn = np.array([point for point in curve if point[1] is not None and point[0] not in motion.borders])
    assert np.all(np.diff(drawn[:, 0]) >= 0.0)
    np.testing.assert_allclose(drawn[:, 1], motion.at(drawn[:, 0])["q0"], rtol=1e-13, atol=1e-13)
    breaks = [time for time, *values in points if None in values]
    assert breaks == [motion.borders[20, 0]]
    known = np.array([point for point in points if None not in point])
    assert known[0, 0] == header["begin"] and known[-1, 0] == header["end"]
    steps = np.diff(known[:, 0])
    assert np.all(steps >= 0.0) and np.sort(steps)[-2] <= 1e-3 + 1e-12  # but for the gap
    inside = ~np.isin(known[:, 0], motion.borders)
    at = motion.at(known[inside, 0])
    np.testing.assert_allclose(known[inside, 1:], np.stack([at["q0"], at["q2"]], axis=1), rtol=1e-13, atol=1e-13)


def test_a_throttled_command_ends_with_the_last_value(modules):
    calls = modules.call("knobs", """
        const calls = [];
        const send = m.throttled((value) => calls.push(value), 20);
        for (let value = 0; value < 10; value += 1) { send(value); }
        return new Promise((done) => { setTimeout(() => done(calls), 80); });""")
    assert calls == [0, 9]


@pytest.mark.parametrize("size", [(600, 500), (380, 300)])
def test_a_robot_on_any_slope_lies_within_its_picture(modules, size):
    scene = vibro_ros.load_scene("device")
    for slope in np.linspace(-1.5, 1.5, 13):
        corners = modules.call("mechanism", """
            const stage = new m.Stage(v[0]);
            stage.fit(v[1], v[2], {});
            const {left, right, top} = stage.box;
            const canvas = new OffscreenCanvas(v[1], v[2]).getContext("2d");
            stage.tilt(canvas);
            const turned = canvas.getTransform();
            return [left, right].flatMap((x) => [0, v[0].hub_height + top].map((z) => {
              const {x: across, y: down} = turned.transformPoint(
                new DOMPoint(stage.middle + stage.scale * x, stage.ground - stage.scale * z));
              return [across, down];
            }));""", drawing(scene.with_parameters({"ground.slope": float(slope)})), *size)
        assert np.all((np.array(corners) >= 0.0) & (np.array(corners) <= size)), slope
        ahead = np.subtract(corners[2], corners[0])  # along the ground: uphill with a positive slope
        np.testing.assert_allclose(np.arctan2(-ahead[1], ahead[0]), slope, rtol=0, atol=1e-9)


def test_a_push_is_there_from_its_begin_to_its_end(modules):
    header, payload = random_motion()
    header["pushes"] = [{"begin": 0.1, "end": 0.2, "force_x": 3.0, "force_z": 0.0}]
    forces = modules.call("motion", BUFFER + """
        return v[2].map((time) => new m.Motion(v[1], buffer).pushAt(time)?.force_x ?? null);""", binary(payload),
                          header, [0.09, 0.1, 0.15, 0.2])
    assert forces == [None, 3.0, 3.0, None]


TEXTS = """  // a surface whose texts are noted: {text, left, right, y} [px]
    const texts = [];
    const noted = (width, height) => {
      const context = new OffscreenCanvas(width, height).getContext("2d");
      context.fillText = (text, x, y) => {
        const {width} = context.measureText(text);
        const left = x - {left: 0, start: 0, center: width / 2, right: width, end: width}[context.textAlign];
        texts.push({text, left, right: left + width, y});
      };
      return {context, width, height, begin: () => context};
    };"""


@pytest.mark.parametrize("size", [(600, 500), (380, 300), (360, 700)])
def test_the_height_of_a_hop_stands_within_the_picture(modules, size):
    texts = modules.call("mechanism", TEXTS + """
        const {context} = noted(v[1], v[2]);
        const stage = new m.Stage(v[0]);
        for (const height of [0.0002, 0.0123, 0.1234]) {
          const values = {body_height: height};
          stage.fit(v[1], v[2], values);
          stage.drawHeight(context, values);
        }
                         return texts;""", drawing(vibro_ros.load_scene("device")), *size)
    assert len(texts) == 3 and all(0.0 <= text["left"] and text["right"] <= size[0] for text in texts)
