"""Tests of distributions by seed: their values, their statistics, and the sentences about invalid ones."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest

from renderer.errors import SettingsError
from renderer.variation import Distribution, Draws, Variation

N = 1000


def drawn(given: Any, count: int = N) -> np.ndarray:
    distribution = Distribution.parse(given, "x")
    return np.array([distribution.draw(Draws(f"test/{n}")) for n in range(count)])


def test_values_follow_from_seed_number_and_name_alone() -> None:
    """The expected bits were computed once; any machine and any release draws the same."""
    variation = Variation.parse({"seed": 7, "objects": {"*": {"scale": {"log_uniform": [0.5, 2.0]}}}})
    first = variation.drawn("objects", ["cup", "plate"], 3)
    assert first == variation.drawn("objects", ["plate", "cup"], 3)
    assert first["cup"] != first["plate"] and first != variation.drawn("objects", ["cup", "plate"], 4)
    assert Draws("7/3/objects/cup/scale").number().hex() == "0x1.27614e564b5acp-2"
    assert float(first["cup"]["scale"]).hex() == "0x1.7ddd206d9a192p-1"  # type: ignore[arg-type]
    assert Draws("a").normal().hex() == "0x1.74448833bf013p+0"


def test_distributions_have_their_moments() -> None:
    """Means within five standard errors, and no value outside its range."""
    uniform = drawn({"uniform": [-1.0, 3.0]})
    assert abs(uniform.mean() - 1.0) < 5 * 4 / math.sqrt(12 * N) and -1 <= uniform.min() < -0.9 and 2.9 < uniform.max() < 3
    log = np.log(drawn({"log_uniform": [0.1, 10.0]}))
    assert abs(log.mean()) < 5 * 2 * math.log(10) / math.sqrt(12 * N) and np.abs(log).max() <= math.log(10) + 1e-12
    normal = drawn({"normal": [2.0, 0.5]})
    assert abs(normal.mean() - 2) < 5 * 0.5 / math.sqrt(N) and abs(normal.std() / 0.5 - 1) < 5 / math.sqrt(2 * N)
    cut = drawn({"normal": [0.0, 1.0], "within": [-0.5, 1.0]})
    assert cut.min() >= -0.5 and cut.max() <= 1.0 and len({*cut.tolist()}) == N
    chosen = drawn({"choice": ["a", "b", "c"], "weights": [1, 0, 3]})
    share = (chosen == "c").mean()
    assert abs(share - 0.75) < 5 * math.sqrt(0.75 * 0.25 / N) and not (chosen == "b").any()
    shell = drawn({"shell": [1.0, 2.0]})
    radius = np.linalg.norm(shell, axis=1)
    assert radius.min() >= 1 and radius.max() <= 2 + 1e-12 and abs(radius.mean() - 1.5) < 5 / math.sqrt(12 * N)
    assert np.abs((shell / radius[:, None]).mean(axis=0)).max() < 5 / math.sqrt(3 * N)
    color = drawn({"uniform": [[0, 0.5, 1], [1, 0.5, 2]]})
    assert color.shape == (N, 3) and (color[:, 1] == 0.5).all() and abs(np.corrcoef(color[:, 0], color[:, 2])[0, 1]) < 0.16


def test_rotations_are_uniform() -> None:
    quaternions = np.array([Draws(f"turn/{n}").quaternion() for n in range(N)])
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(quaternions.T @ quaternions / N, np.eye(4) / 4, atol=5 / math.sqrt(16 * N))


WRONG: dict[str, tuple[Any, str]] = {
    "list": ([], "vary must be a mapping"),
    "section": ({"object": {}}, "vary has 'object', .*known are objects"),
    "nothing": ({"seed": 1}, "vary varies nothing"),
    "seed": ({"seed": -1}, "vary.seed is -1; it must be a whole number of at least 0"),
    "every": ({"every": 0.5}, "vary.every is 0.5"),
    "what": ({"objects": {"a": {"jump": 1}}}, "vary.objects.a has 'jump'.*known are move"),
    "distribution": ({"objects": {"a": {"scale": {"gauss": [0, 1]}}}}, "vary.objects.a.scale is .*give a value that fits"),
    "reversed": ({"objects": {"a": {"scale": {"uniform": [2, 1]}}}}, "a.scale is"),
    "log of 0": ({"objects": {"a": {"scale": {"log_uniform": [0, 1]}}}}, "a.scale is"),
    "shell of a number": ({"objects": {"a": {"scale": {"shell": [1, 2]}}}}, "a.scale is"),
    "lengths": ({"objects": {"a": {"move": {"uniform": [[0, 0, 0], [1, 1]]}}}}, "a.move is"),
    "empty choice": ({"lights": {"a": {"power": {"choice": []}}}}, "a.power is"),
    "weights": ({"lights": {"a": {"power": {"choice": [1, 2], "weights": [1]}}}}, "a.power is"),
    "not finite": ({"environment": {"rotation": math.nan}}, "environment.rotation is nan"),
    "within": ({"environment": {"rotation": {"normal": [0, 1], "within": [2, 1]}}}, "rotation.within is"),
    "flag": ({"objects": {"a": {"tumble": 3}}}, "a.tumble is 3"),
    "large number in a triple": ({"lights": {"a": {"move": [10**400, 0, 0]}}}, "a.move is"),
    "number of too many digits": ({"seed": 10**5000}, "vary.seed is"),
    "deep": ({"lights": {"a": {"power": functools.reduce(lambda inner, _: [inner], range(10**5), [])}}}, "a.power is"),
    "long pattern": ({"objects": {"[" * 10**5: {"turn": 1}}}, "vary.objects has"),  # it would take minutes to translate
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_one_sentence(case: str) -> None:
    given, message = WRONG[case]
    with pytest.raises(SettingsError, match=message) as caught:
        Variation.parse(given)
    assert "\n" not in str(caught.value) and caught.value.field == "vary"


def test_the_first_pattern_that_matches_applies_and_unknown_names_are_refused() -> None:
    rules = {"cup-1": {"scale": 2}, "cup-*": {"scale": 3}}
    found = Variation.parse({"objects": rules}).drawn("objects", ["cup-1", "cup-2", "floor"], 0)
    assert found == {"cup-1": {"scale": 2.0}, "cup-2": {"scale": 3.0}}
    with pytest.raises(SettingsError, match=r"vary.objects: 'cup-1' is none of the scene's; it has cap, floor"):
        Variation.parse({"objects": rules}).check_names("objects", ["cap", "floor"])
