"""Tests of validating the names of scenes and jobs."""

from __future__ import annotations

import pytest

from service.errors import Invalid
from service.intake.names import plain_title


@pytest.mark.parametrize("title", ["Küche", "🏠 № 3", "  a  b ", "", "שלום", "क्ष"])
def test_one_line_of_text_is_valid_name(title: str) -> None:
    assert plain_title(title) == title.strip()


@pytest.mark.parametrize("title", ["a\0b", "a\r\nb", "a\tb", "a\x7fb", "a\u2028b", "a\u0085b", "\ud800", "txt.\u202ejbo"])
def test_several_lines_are_no_valid_name(title: str) -> None:
    with pytest.raises(Invalid, match="control characters"):
        plain_title(title)
