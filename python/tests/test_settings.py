"""Settings and options: one source, that of the command line."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import interslice
import pytest
from interslice import _native


def stubs(name: str) -> set[str]:
    """The names that a class of the stubs lists."""
    text = (Path(interslice.__file__).parent / "_options.py").read_text()
    body = text.split(f"class {name}(")[1].split("class ")[0]
    return {line.split(":")[0].strip() for line in body.splitlines()[1:] if ":" in line}


def test_stubs_have_the_names_of_the_module() -> None:
    names = {kind: set(of) for kind, of in _native._names().items()}
    # Profiles are written to the terminal.
    assert stubs("SettingsOptions") == names["settings"] | names["machine"] - {"profile"}
    # The grid of another image is for files alone.
    assert stubs("RunOptions") == names["output"] - {"like"}
    assert stubs("ReadOptions") | {"axis", "spacing"} == names["read"] - {"complete_slices"}


def test_defaults_and_help_are_those_of_the_command_line(command: Callable[..., Any]) -> None:
    told = command("reconstruct", "--help").stdout
    default = interslice.Settings()
    assert default == interslice.Settings(fair=1.5) and default.method == "morph" and default.spline_end is None
    for option in interslice.Settings.options():
        name = option["name"].replace("_", "-")
        section = next(part for part in told.split("\n      --") if part.split()[0] == name)
        assert option["help"].splitlines()[0][:40] in " ".join(section.split()), name
        if option["default"] is not None:
            assert f"[default: {option['default']}]" in " ".join(section.split()), name
            value = getattr(default, option["name"])
            assert type(value)(option["default"]) == value
        if option["choices"]:
            assert getattr(default, option["name"]) in [*option["choices"], None]


def test_settings_are_values() -> None:
    fast = interslice.Settings("fast", end_top="extrapolate")
    assert (fast.method, fast.end_top) == ("field", "extrapolate")
    assert repr(fast) in ("Settings(end_top='extrapolate', method='field')", "Settings(method='field', end_top='extrapolate')")
    assert pickle.loads(pickle.dumps(fast)) == copy.deepcopy(fast) == fast
    assert fast.replace(fair=0.5) == interslice.Settings(method="field", end_top="extrapolate", fair=0.5)
    assert fast.to_dict()["fair"] == 1.5 and "cfl" in dir(fast)
    links = [{"slice": 0, "from": 1, "to": 2}]
    assert interslice.Settings(links=links).links == [{"slice": 0, "from": 1, "to": 2, "join": True}]
    with pytest.raises(AttributeError, match="there is no setting `fairness`"):
        fast.fairness  # noqa: B018


@pytest.mark.parametrize(
    ("wrong", "error", "words"),
    [
        ({"fair": 9}, ValueError, r"`fair` must lie in \[0, 1.5\]; got 9"),
        ({"method": "magic"}, ValueError, "`method` = \"magic\": expected morph or field"),
        ({"method": 1}, ValueError, "`method` = 1: expected morph or field"),
        ({"fair": "much"}, ValueError, 'invalid type: string "much", expected a number'),
        ({"fairing": 1}, TypeError, "unknown option `fairing`; there are method, fair"),
        ({"fair": object()}, TypeError, "`fair` must be a number, a text, True, False or a list; got object"),
        ({"preset": "slow"}, ValueError, "`preset` must be one of paper, fast; got `slow`"),
        ({"end_top": "round"}, ValueError, "must be flat, half-slice, extrapolate or peak=HEIGHT; got `round`"),
    ],
)
def test_wrong_settings(wrong: dict[str, Any], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        interslice.Settings(**wrong)
