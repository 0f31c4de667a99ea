"""A call of a program in a process of its own: a peer that spoils its memory spoils no other's."""

import multiprocessing
import os

FORK = multiprocessing.get_context("fork")


def answer(pipe, call, given, warm, finish):
    """Calls a program, and sends what it made, CPU seconds (user and system, its own processes' too) and no words, or nothing and why it failed."""
    try:
        if warm is not None:
            call(warm)
        start = sum(os.times()[:4])
        found = call(given)
        seconds = sum(os.times()[:4]) - start
        pipe.send((finish(found), seconds, ""))
    except Exception as error:  # noqa: BLE001  whatever a peer does, the others are measured
        pipe.send((None, 0.0, f"{type(error).__name__}: {error}".replace("\n", " ")[:120]))
    pipe.close()
    os._exit(0)


def attempt(call, given, limit, warm=None, finish=lambda found: found):
    """What `call` makes of `given`, after `finish`; CPU seconds; why it failed. `warm` is what it is called on once before it is timed."""
    here, there = FORK.Pipe(duplex=False)
    child = FORK.Process(target=answer, args=(there, call, given, warm, finish))
    child.start()
    there.close()
    try:
        found = here.recv() if here.poll(limit) else (None, 0.0, f"no answer within {limit} s")
    except EOFError:
        found = None, 0.0, "the process died"
    child.kill()
    child.join()
    return found
