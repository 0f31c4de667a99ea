"""Rows of results: what a program makes of a body given by slices, and the order in which rows that are missing are made."""

import time

from . import measures, programs
from .calls import attempt
from .results import TRUTH


def mask_row(name, body, surface, limit):
    """Measures of the mask that a program makes of `body` (given, truth, gap, inradius) beside the true surface, or why there are none; and
    the mask. `limit` is in seconds. The row of the truth says what body it is."""
    if name == TRUTH:
        mask, seconds, sides = body.truth, 0.0, body.given.spacing[1:]
        about = {"gap": body.gap, "inradius": body.inradius, "long": max(sides) / min(sides)}
    else:
        call, about = programs.PROGRAMS[name][0], {}
        warm = None if call in programs.COMMANDS else programs.WARM
        mask, seconds, failure = attempt(call, body.given, limit, warm, programs.mask_of)
        if mask is None:
            return {"failure": failure}, None
    if not mask.any():
        return about | {"failure": "nothing came out", "seconds": seconds}, mask
    return about | measures.measure(body, mask, surface) | {"seconds": seconds}, mask


def go_on(todo, minutes):
    """Does each piece of work, `(what it is of, what to call)`, one after the other; begins none after so many minutes. Says whether all is
    done."""
    start = time.monotonic()
    for name, work in todo:
        if minutes is not None and time.monotonic() - start > 60 * minutes:
            print(f"{minutes:g} minutes are over; run again to go on at {name}")
            return False
        work()
        print(f"{name}, {time.monotonic() - start:.0f} s", flush=True)
    return True
