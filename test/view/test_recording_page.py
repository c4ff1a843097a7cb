"""The page of a recording: one file that shows the positions of all parts without a network."""

import json
import re

import numpy as np
import pytest
from page_reading import COLOURED, open_file, until, wait_for
from robot_bag import robot_bag

import vibro_ros
from vibro_ros.process.entry_point import BAD_INPUT
from vibro_ros.view import view
from vibro_ros.view.page import MARK, page_text

SECONDS = 2.0
SPEED = 100.0  # rad/s
CLOSE = 1e-9  # m


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return robot_bag(tmp_path_factory.mktemp("bags") / "vibro_robot", "device", int(200 * SECONDS) + 1,
                     {0: {"motor_speed": SPEED}})


@pytest.fixture(scope="module")
def file(bag):
    return view.write_page(bag)


@pytest.fixture
def opened(page, file):
    """Open the recording, paused."""
    page.emulate_media(reduced_motion="reduce")
    open_file(page, file)
    return page


def test_the_file_lies_beside_the_recording_and_may_be_written_again(bag, file):
    assert file == bag.with_name("vibro_robot_view.html")
    content_before = file.read_bytes()
    assert view.write_page(bag) == file and file.read_bytes() == content_before


def test_the_drawing_agrees_with_the_simulator(opened):
    for moment in np.random.default_rng(4).uniform(0.0, SECONDS, 40):
        device = vibro_ros.Simulator(vibro_ros.load_scene("device"))
        device.command(motor_speed=SPEED)
        device.advance_to(moment)
        drawn = opened.evaluate("(time) => vibro.show(time)", moment)
        assert drawn["time"] == moment
        for name in ("body_position", "body_height", "upper_position", "inclined_position", "upper_plate_position"):
            assert abs(drawn["quantities"][name] - getattr(device.state, name)) < CLOSE, name


def test_the_keyboard_plays_pauses_and_goes_from_impact_to_impact(opened):
    times = [impact["time"] for impact in header_of(opened)["impacts"]]
    opened.evaluate("vibro.show(1.0)")
    after = [moment for moment in times if moment > 1.0]
    for expected in after[:3]:
        opened.keyboard.press("ArrowRight")
        wait_for(opened, f"Math.abs(vibro.drawn().time - {expected!r}) < 1e-12")
    opened.keyboard.press("ArrowLeft")
    wait_for(opened, f"Math.abs(vibro.drawn().time - {after[1]!r}) < 1e-12")
    opened.select_option("#speed", label="1/1000")
    opened.focus("#speed")
    opened.keyboard.press(".")
    wait_for(opened, f"Math.abs(vibro.drawn().time - {after[1] + 1e-3 / 60!r}) < 1e-12")
    opened.keyboard.press(",")
    wait_for(opened, f"Math.abs(vibro.drawn().time - {after[1]!r}) < 1e-12")
    opened.evaluate("document.activeElement.blur()")
    opened.keyboard.press("Space")
    wait_for(opened, "document.querySelector('#play').ariaLabel === 'Pause'")
    wait_for(opened, f"vibro.drawn().time > {after[1] + 1e-4!r}")
    opened.keyboard.press("Space")
    wait_for(opened, "document.querySelector('#play').ariaLabel === 'Play'")


def header_of(page):
    return json.loads(page.text_content("#motion-header"))


def test_the_time_line_and_the_charts_lead_to_an_instant(opened):
    opened.evaluate("vibro.show(0.5)")
    opened.fill("#timeline", "1.25")
    wait_for(opened, "Math.abs(vibro.drawn().time - 1.25) < 1e-9")
    box = opened.locator("#charts").bounding_box()
    opened.mouse.click(box["x"] + 0.3 * box["width"], box["y"] + 100)
    wait_for(opened, "vibro.drawn().time < 1")


def test_a_dc_motor_has_voltage_and_current_among_the_numbers_and_a_push_is_drawn(opened, tmp_path):
    until(opened, lambda page: "mm" in page.text_content("#readings tr:first-child td"), "the body's displacement")
    assert opened.locator("#readings td").count() > 6 and "voltage" not in opened.text_content("#readings")
    push = 'push {"duration": 0.2, "force_x": 20.0, "force_z": 0.0}'
    bag = robot_bag(tmp_path / "bag", "machine", 201, {0: {"motor_speed": SPEED}, 90: push})
    open_file(opened, view.write_page(bag))
    opened.evaluate("vibro.show(0.55)")
    run = vibro_ros.Simulator(vibro_ros.load_scene("machine"))
    run.command(motor_speed=SPEED)
    run.advance_to(0.45)
    run.push(0.2, force_x=20.0)
    run.advance_to(0.55)
    for name, right, unit in (("motor voltage", f"{run.state.motor_voltage:.2f}", "V"),
                              ("motor current", f"{run.state.motor_current:.3f}", "A")):
        row = opened.locator("#readings tr", has_text=name).locator("td")
        until(opened, lambda page, row=row, right=right, unit=unit: row.inner_text() == f"{right} {unit}", name)
    assert opened.evaluate(COLOURED, "accent")[2] > 20.0  # px² of the arrow
    opened.evaluate("vibro.show(0.66)")
    assert opened.evaluate(COLOURED, "accent")[2] == 0.0


def picture(page, name: str) -> str:
    return page.evaluate(f"document.querySelector('{name}').toDataURL()")


def test_the_mean_speed_is_that_of_the_simulator_over_the_time_that_it_names(opened):
    run = vibro_ros.simulate(vibro_ros.load_scene("device"), times=np.linspace(0.0, SECONDS, 4001),
                             commands=[(0.0, {"motor_speed": SPEED})])
    for moment in (1.0, SECONDS):
        opened.evaluate("(time) => vibro.show(time)", moment)
        until(opened, lambda page, moment=moment: page.inner_text("#mean-over") == f"mean of the last {moment:.1f} s")
        speed = 1e3 * run.body_position[round(moment * 2000)] / moment
        assert opened.inner_text("#mean-speed").replace("\u2212", "-") == f"{speed:.1f} mm/s"


def test_the_page_describes_its_picture_on_request(opened, page):
    opened.evaluate("vibro.show(1.0)")
    plain = picture(opened, "#mechanism")
    opened.keyboard.press("h")
    until(opened, lambda page: picture(page, "#mechanism") != plain, "names in the drawing")
    words = opened.inner_text("#about")
    assert all(name in words for name in ("body", "crank", "rods", "sliders", "mass", "plates", "spring", "Keys"))
    assert opened.evaluate("document.activeElement.id") == "close"
    opened.keyboard.press("Escape")
    assert opened.is_hidden("#about") and opened.evaluate("document.activeElement.id") == "explain"
    until(opened, lambda page: picture(page, "#mechanism") == plain, "the drawing without names")
    opened.check("#forces")
    until(opened, lambda page: picture(page, "#mechanism") != plain, "forces")


def test_the_page_states_the_time_in_the_air_correctly():
    for speed, share, words in ((60.0, 2 / 3, "two thirds of the time at 60"), (200.0, 0.9, "nine tenths at 200")):
        scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": speed})
        run = vibro_ros.simulate(scene, duration=12.0, rate=1000.0)
        assert (run.body_height[6000:] > 0.0).mean() == pytest.approx(share, abs=0.05)
        blows = run.events[run.events["kind"] == "upper_contact"]
        assert np.median(blows["duration"]) == pytest.approx(0.3e-3, abs=0.05e-3)
        assert np.median(blows["peak_force"]) > 1e3
        assert 1e-3 < run.body_height[6000:].max() < 0.1
        assert words in " ".join(page_text({"mode": "live", "title": ""}).split())


def test_a_chart_has_the_mean_speed_of_the_last_second(opened):
    opened.evaluate("""() => { globalThis.texts = []; const real = CanvasRenderingContext2D.prototype.fillText;
        CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {
          texts.push(text);
          real.call(this, text, ...rest);
        }; }""")

    def drawn(moment):
        return opened.evaluate("(time) => { texts.length = 0; vibro.show(time); return texts; }", moment)

    place_before, place_now = (opened.evaluate("(time) => vibro.show(time).quantities.body_position", at)
                               for at in (0.5, 1.5))
    texts = drawn(1.5)
    number = texts[texts.index("speed over ground, mean of a second [mm/s]") + 1]
    assert abs(float(number.replace("\u2212", "-")) - 1e3 * (place_now - place_before)) < 1.0
    opened.select_option("#speed", "0.1")  # less than a second is shown: the curve would be a line
    assert not any(text.startswith("speed") for text in drawn(1.5))


def test_phase_portraits_are_drawn_in_place_of_the_strip_charts(opened):
    opened.evaluate("vibro.show(1.0)")
    strips = picture(opened, "#charts")
    opened.select_option("#kind", "portraits")
    until(opened, lambda page: picture(page, "#charts") != strips, "portraits")
    assert opened.get_attribute("#charts", "aria-label").startswith("phase portraits; ")
    opened.locator("#charts").click(position={"x": 200, "y": 100})
    assert opened.evaluate("vibro.drawn().time") == 1.0  # its axis is none of time
    opened.select_option("#kind", "time")
    until(opened, lambda page: picture(page, "#charts") == strips, "strip charts")


def test_a_folder_s_name_is_text_and_no_program():
    name = "</title></script><script>document.title = 'taken'</script>"
    text = page_text({"mode": "live", "title": name, "version": "<!--", "robot": name})
    assert "<script>document" not in text and MARK in text
    policy = re.search(r"Content-Security-Policy\" content=\"([^\"]+)", text)[1]
    assert "default-src 'none'" in policy and "connect-src 'none'" in policy and "unsafe" not in policy


def test_a_damaged_page_shows_an_error(page, file, watch, tmp_path):
    text = file.read_text()
    damaged = tmp_path / "damaged.html"
    damaged.write_text(re.sub(r'(text/plain">)[^<]{400}', r"\1", text))
    page.goto(damaged.as_uri())
    wait_for(page, "!document.querySelector('#note').hidden")
    watch.expect("rror")


@pytest.mark.parametrize("opens", [True, False])
def test_a_recordings_page_is_opened_on_request(bag, monkeypatch, capsys, tmp_path, opens):
    asked = []
    monkeypatch.setattr(view.webbrowser, "open", lambda address: asked.append(address) or opens)
    page = tmp_path / "page.html"
    assert view.main([str(bag), "--output", str(page), "--open"]) == 0
    said = capsys.readouterr()
    assert asked == [page.as_uri()] and said.out == f"{page}\n"
    assert said.err == ("" if opens else "view: no browser could be opened; open the file above\n")


def test_other_files_and_the_recording_are_not_overwritten(bag, tmp_path, capsys):
    other = tmp_path / "letter.html"
    other.write_text("<p>Dear Mum")
    for words, expected in (([str(bag), "--output", str(other)], "no page that `view` wrote"),
                            ([str(bag), "--output", str(bag / "page.html")], "lies inside the recording"),
                            ([str(bag), "--output", str(tmp_path / "none" / "page.html")], "cannot write"),
                            ([str(tmp_path / "nothing")], "no such folder"), (["--output", "x"], "BAG_FOLDER")):
        assert view.main(words) == BAD_INPUT
        said = capsys.readouterr()
        assert said.out == "" and said.err.startswith("view: ") and said.err.count("\n") == 1 and expected in said.err
    assert other.read_text() == "<p>Dear Mum"
