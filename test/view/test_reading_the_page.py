"""The page is readable and usable: to scale, in two sizes and two themes, by keyboard and by screen reader."""

import numpy as np
import pytest
from page_reading import COLOURED, drawn, enter, shows_robot, until
from real_processes import CRAWL
from robot_bag import robot_bag

import vibro_ros
from vibro_ros.view.view import write_page

SIZES = [(1280, 720, False), (390, 844, True)]
CONTROLS = "button, input, select"
SMALLEST_TARGET = 24  # px, WCAG 2.5.8
LEAST_CONTRAST = 4.5  # WCAG 1.4.3
UNREADABLE = """least => {  // texts that are too small or too pale, or stand out of the window
    const channel = value => value <= 0.03928 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
    const parse = text => text.match(/[\\d.]+/g).map(Number);
    const light = ([r, g, b]) => 0.2126 * channel(r / 255) + 0.7152 * channel(g / 255) + 0.0722 * channel(b / 255);
    const ground = element => {
        for (let one = element; one; one = one.parentElement) {
            const colour = parse(getComputedStyle(one).backgroundColor);
            if (colour.length === 3 || colour[3] === 1) { return colour; }
        }
        return [255, 255, 255];
    };
    const found = [];
    for (const element of document.querySelectorAll("body *")) {
        const texts = [...element.childNodes].filter(one => one.nodeType === 3);
        const text = texts.map(one => one.textContent.trim()).join("");
        if (!text || !element.checkVisibility() || element.closest(".unseen, script, select, :disabled")) { continue; }
        const style = getComputedStyle(element);
        const box = element.getBoundingClientRect();
        const [a, b] = [light(parse(style.color)), light(ground(element))];
        const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        if (contrast < least) { found.push(`${text}: contrast ${contrast.toFixed(2)}`); }
        if (parseFloat(style.fontSize) < 11) { found.push(`${text}: ${style.fontSize}`); }
        if (box.left < -0.5 || box.right > innerWidth + 0.5) { found.push(`${text}: outside the window`); }
        const flows = style.overflowX === "visible" && style.display !== "inline";
        if (flows && element.scrollWidth > element.clientWidth + 1) {
            found.push(`${text}: runs out of its box`);
        }
    }
    return found;
}"""
BOXES = """selector => [...document.querySelectorAll(selector)].filter(one => one.checkVisibility()
    && !one.closest(".unseen")).map(one => {
    const label = one.closest("label") ?? one;
    const box = (one.type === "checkbox" ? label : one).getBoundingClientRect();
    return {name: one.id || one.getAttribute("aria-label"), left: box.left, right: box.right, top: box.top,
        bottom: box.bottom};
})"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    def of_scene(changes):
        scene = vibro_ros.load_scene("device").with_parameters(changes)
        return write_page(robot_bag(tmp_path_factory.mktemp("bags") / "vibro_robot", scene, 401,
                                    {0: {"motor_speed": 100.0}}))
    return of_scene


@pytest.fixture(scope="module")
def file(recording):
    return recording({})


@pytest.mark.parametrize("slope", [0.0, 0.15, -0.9])
def test_masses_are_drawn_where_they_are_and_to_scale(page, recording, slope):
    """On a slope x points uphill, and gravity points down in the picture."""
    file = recording({"ground.slope": slope, "ground.friction": 1.0})
    cos, sin = np.cos(slope), np.sin(slope)
    page.emulate_media(reduced_motion="reduce", color_scheme="light")
    page.goto(file.as_uri())
    until(page, lambda page: page.is_enabled("#timeline"))
    page.select_option("#speed", "0.001")  # no flash, and no force beside it, outlasts 0.1 ms
    machine = page.evaluate("JSON.parse(document.querySelector('#setting').textContent).machine")
    header = page.evaluate("JSON.parse(document.querySelector('#motion-header').textContent)")
    blows = np.array([(impact["time"], impact["end"]) for impact in header["impacts"]])
    times = [time for time in np.linspace(0.8, 1.9, 30)
             if not ((blows[:, 0] - 1e-3 < time) & (time < blows[:, 1] + 1e-3)).any()]
    for guide in machine["guides"]:
        rows, seen = [], []
        for time in times:
            shown = page.evaluate("time => vibro.show(time)", float(time))["quantities"]
            along = shown[f"{guide['side']}_position"]
            ahead, up = -along * np.sin(guide["angle"]), along * np.cos(guide["angle"]) + shown["body_height"]
            rows.append((ahead * cos - up * sin, -ahead * sin - up * cos))
            seen.append(page.evaluate(COLOURED, guide["side"]))
        expected, seen_places = np.array(rows), np.array(seen)[:, :2]
        centred = expected - expected.mean(axis=0), seen_places - seen_places.mean(axis=0)
        scale = (centred[0] * centred[1]).sum() / (centred[0] ** 2).sum()  # px/m
        assert np.abs(centred[1] - scale * centred[0]).max() < 0.75, guide["side"]  # px, of centres of pixels
        area = 0.022 * machine["mass_height"] * scale**2
        assert np.array(seen)[:, 2] == pytest.approx(area, rel=0.15)  # px², without the rim's mixed colours


def test_a_live_page_can_be_read_reached_and_heard(start, view, open_page):
    start("robot", *CRAWL)
    pages = [open_page(*size) for size in SIZES]
    for page in pages:
        page.goto(view.address.url)
        until(page, shows_robot)
    enter(pages[0], "motor_speed", "1e6")
    for page, (width, _, touch) in zip(pages, SIZES, strict=True):
        until(page, lambda page: "1e+06" in page.inner_text("#said") or  # of another page, or beside the own field
              "1000000 is refused" in page.inner_text("#motor_speed_words"), "a refusal")
        check_words(page)
        if not touch:
            assert page.evaluate("document.scrollingElement.scrollHeight <= innerHeight")  # all at a glance
        check_places(page, width, touch)
        page.click("#explain")
        stage, about = (page.locator(name).bounding_box() for name in ("#stage", "#about"))
        gap = about["y"] - stage["y"] - stage["height"] if touch else about["x"] - stage["x"] - stage["width"]
        assert 0.0 <= gap < 20.0  # the words stand beside the drawing, on a phone below it
        check_words(page)
        page.keyboard.press("Escape")
        page.evaluate("scrollTo(0, document.scrollingElement.scrollHeight)")
        stop = page.locator("#stop").bounding_box()
        assert 0.0 <= stop["y"] and stop["y"] + stop["height"] <= page.evaluate("innerHeight")  # wherever one reads
    check_screen_reader(pages[0])
    check_keyboard(pages[0])


def check_words(page) -> None:
    """Check that all words can be read in both themes, and that nothing reaches beyond the window."""
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)
        assert page.evaluate(UNREADABLE, LEAST_CONTRAST) == []
    assert page.evaluate("document.scrollingElement.scrollWidth <= innerWidth")


def check_places(page, width: int, touch: bool) -> None:
    """Check that controls lie in the window, apart, large enough for a finger, and beside their own labels."""
    boxes = page.evaluate(BOXES, CONTROLS)
    assert {"motor_speed", "upper_gap", "ground_friction", "stop", "reset", "pause", "step", "record", "slow"} <= {
        box["name"] for box in boxes}
    for number, box in enumerate(boxes):
        assert box["left"] >= 0.0 and box["right"] <= width, box
        assert not touch or box["bottom"] - box["top"] >= SMALLEST_TARGET, box
        assert not any(overlap(box, other) for other in boxes[:number]), box
    labels = page.evaluate(BOXES, "#knobs label")
    for label, name in zip(labels, ("motor_speed", "upper_gap", "inclined_gap", "ground_friction"), strict=True):
        knob = next(box for box in boxes if box["name"] == name)
        below = [other["top"] for other in labels if other["top"] > label["top"] + 2]
        assert knob["top"] < min(below, default=1e9)


def overlap(box: dict, other: dict) -> bool:
    """Whether two boxes overlap by more than a pixel in both directions."""
    return (min(box["right"], other["right"]) - max(box["left"], other["left"]) > 1
            and min(box["bottom"], other["bottom"]) - max(box["top"], other["top"]) > 1)


def check_keyboard(page) -> None:
    """Check that the tabulator reaches every control, and that keys command the motor and pause the robot."""
    page.evaluate("document.activeElement.blur()")
    until(page, lambda page: page.is_enabled("#pause") and page.is_enabled("#record"), "services")
    controls = set(page.evaluate(f"""[...document.querySelectorAll("{CONTROLS}")].filter(one => !one.disabled
        && one.checkVisibility()).map(one => one.id || one.getAttribute("aria-label"))"""))
    reached = set()
    for _ in range(3 * len(controls)):
        page.keyboard.press("Tab")
        name, outline = page.evaluate("""[document.activeElement].map(one =>
            [one.id || one.getAttribute("aria-label"), getComputedStyle(one).outlineStyle])[0]""")
        if name in controls:
            assert outline != "none", name  # the focus can be seen
        reached.add(name)
    assert controls <= reached
    page.focus("#motor_speed")
    page.keyboard.press("Control+a")
    page.keyboard.type("60")
    page.keyboard.press("Enter")
    until(page, lambda page: drawn(page)["quantities"]["motor_speed"] == 60.0, "the command")
    page.keyboard.press("Shift+Tab")
    if page.evaluate("document.activeElement.type") != "range":
        page.focus("input[type=range]:enabled")
    page.keyboard.press("ArrowUp")
    until(page, lambda page: drawn(page)["quantities"]["motor_speed"] > 60.0, "the slider's command")
    page.focus("#pause")
    page.keyboard.press("Space")
    until(page, lambda page: page.inner_text("#pause") == "Resume", "paused")


def check_screen_reader(page) -> None:
    """Check that controls have names for a screen reader, that messages are announced, and that numbers change."""
    nodes = page.context.new_cdp_session(page).send("Accessibility.getFullAXTree")["nodes"]
    received = [(node["role"]["value"], node.get("name", {}).get("value", ""))
                for node in nodes if not node["ignored"]]
    for role, name in received:
        if role in ("button", "slider", "textbox", "checkbox", "combobox", "image"):
            assert name.strip(), (role, received)
    roles = [role for role, _ in received]
    assert {"heading", "main", "log", "image", "textbox", "slider", "button", "checkbox"} <= set(roles)
    assert page.get_attribute("html", "lang") == "en"
    assert page.get_attribute("#said", "aria-live") == "polite"
    readings_before = page.text_content("#readings")
    until(page, lambda page: page.text_content("#readings") != readings_before, "other numbers")
