"""The page of `study identify`: one file, whose pictures show the recording and the robot that was found."""

from dataclasses import replace

import numpy as np
import pytest

import vibro_lab
import vibro_ros
from vibro_lab.identification.identify import Alternative
from vibro_lab.study import identify as study

pytest.importorskip("heyoka", reason="heyoka, the extra `bench`, is not installed")

from laboratory import record

FREE = ["ground.friction", "upper.gap"]
NOISE = {"position": 5e-5, "velocity": 1e-3, "angle": 5e-4}  # m, m/s, rad: of the laboratory's sensors
QUANTILE = 3.841  # of a chi square with one degree of freedom, 95 %


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return record(tmp_path_factory.mktemp("bags") / "bag", "damped", duration=1.0, spread=0.0)


@pytest.fixture(scope="module")
def identified(made):
    return vibro_lab.identify(made.bag, made.truth.with_parameters({"ground.friction": 0.205}), FREE, workers=1)


@pytest.fixture(scope="module")
def file(made, identified, tmp_path_factory):
    """The page that the command writes of this fit, with a window left out and another effect that fits better."""
    windows = identified.windows.copy()
    windows["used"][2] = False
    better = Alternative("slope", 41.5, 1e-9, identified.values, identified.scene, 1.01)
    folder = tmp_path_factory.mktemp("output")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "identify", lambda *_, **__: replace(identified, windows=windows, alternatives=(better,)))
        assert study.main([str(made.bag), "--scene", "damped", "--output", str(folder)]) == 0
    return folder / study.PAGE


def test_simulated_values_are_those_of_the_true_robot(made, identified):
    for channel in identified.recording.channels:
        times, values = identified.simulated[f"{channel.sensor}.{channel.field}"].T
        assert len(times) > 0.9 * len(channel.times)
        true = vibro_ros.simulate(made.truth, times=times, commands=identified.recording.commands)
        noise = NOISE[channel.field.rpartition("_")[2]]  # the median of which is 0.67 of it, of the measured values
        assert np.median(np.abs(values - getattr(true, channel.field))) < 0.3 * noise


def test_profiles_grow_from_the_value_to_the_quantile_at_the_ends(identified):
    for name, points in identified.profiles.items():
        values, growths = points.T
        assert growths[values == identified.values[name]] == [0.0]
        assert (np.diff(growths[values <= identified.values[name]]) < 0.0).all()
        assert (np.diff(growths[values >= identified.values[name]]) > 0.0).all()
        assert np.interp(identified.intervals[name], values, growths) == pytest.approx(QUANTILE, rel=0.1)


@pytest.mark.parametrize("width", [1280, 390])
def test_the_page_shows_verdict_and_pictures_without_another_file(file, identified, open_page, width):
    page = open_page(width, 800)
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(file.as_uri())
    first = page.evaluate("document.querySelector('h1, h2, h3').outerHTML")
    assert first.startswith("<h1>The effect slope fits better")
    pictures = page.evaluate("[...document.images].map(one => [one.alt, one.complete && one.naturalWidth > 100])")
    assert all(drawn for _, drawn in pictures)
    captions = [caption for caption, _ in pictures]
    for channel in identified.recording.channels:
        shown = f"{channel.sensor}: {channel.field.replace('_', ' ')}"
        assert sum(caption.startswith(shown) for caption in captions) == 1
    assert set(FREE) < set(captions)
    assert len(captions) == len(identified.recording.channels) + len(FREE) + 1  # and windows
    words = page.evaluate("document.body.innerText")
    for part in ("slope\t41.5\t1e-09", *identified.said, *identified.rank):
        assert part in words
    assert [url for url in asked if not url.startswith("data:")] == [file.as_uri()]
    assert page.evaluate("document.scrollingElement.scrollWidth <= document.documentElement.clientWidth")
