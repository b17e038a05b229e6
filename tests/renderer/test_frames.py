"""Tests of frame ranges such as 0-3: they are parsed in the written order, printed, and used in file names."""

import pytest

from renderer.errors import SettingsError
from renderer.frames import frame_name, frames_text, numbers_of, parse_frames


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("0", [0]),
        ("0-3", [0, 1, 2, 3]),
        ("1-11x5,300", [1, 6, 11, 300]),
        ("1-12:5", [1, 6, 11]),
        ("5, 3-4, 4-6", [5, 3, 4, 6]),
        ("0-1x0.5", [0, 0.5, 1]),
        ("2.5", [2.5]),
    ],
)
def test_frame_ranges_are_parsed_in_order(text, frames):
    assert parse_frames(text) == frames


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "give numbers and ranges such as 0-99"),
        ("5-", "give numbers and ranges such as 0-99"),
        ("-3", "give numbers and ranges such as 0-99"),
        ("one", "give numbers and ranges such as 0-99"),
        ("1.25", "give numbers and ranges such as 0-99"),
        ("1,,2", "give numbers and ranges such as 0-99"),
        ("9-3", "the range 9-3 ends before it begins"),
        ("1-9x0", r"steps of at least 0\.5"),
        ("0-99999999", "end at 10000000 at most"),
        ("0-200000", "more than 100000 frames"),
        (",".join(["0-49999"] * 1200), "more than 100000 frames"),  # without an early limit parsing this took half a minute
    ],
)
def test_invalid_range_is_an_error(text, sentence):
    with pytest.raises(SettingsError, match=sentence):
        parse_frames(text)


@pytest.mark.parametrize(
    ("pattern", "frame", "name"),
    [
        ("out.####.exr", 12, "out.0012.exr"),
        ("out.####.exr", 12345, "out.12345.exr"),
        ("out.####.exr", 12.5, "out.0012.5.exr"),
        ("#.png", 7, "7.png"),
        ("shot#3_##.png", 7, "shot#3_07.png"),
        ("still.png", 7, "still.png"),
    ],
)
def test_file_name_contains_the_frame_number(pattern, frame, name):
    assert frame_name(pattern, frame) == name


def test_consecutive_frames_are_formatted_as_ranges():
    assert frames_text([4, 0, 1, 2, 7.5, 9, 10, 1000000]) == "0-2,4,7.5,9-10,1000000"
    assert parse_frames(frames_text([3, 4, 5, 9])) == [3, 4, 5, 9]


def test_existing_frame_files_are_found():
    names = ["a.0003.obj", "a.0012.obj", "a.12345.obj", "a.12.obj", "a.00013.obj", "b.0001.obj", "a.0001.mtl"]
    assert numbers_of("a.####.obj", names) == [3, 12, 12345]
    assert numbers_of("a.#.obj", names) == [12, 12345]
    assert numbers_of("a.obj", names) == []
