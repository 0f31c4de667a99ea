"""The command `interslice`: the command line that is in the module."""

import os
import sys

from interslice._native import command


def main() -> int:
    # Without a desktop, Mesa's layer that ranks GPUs says on stderr that it found none.
    if "XDG_RUNTIME_DIR" not in os.environ:
        os.environ.setdefault("NODEVICE_SELECT", "1")
    return command(["interslice", *sys.argv[1:]])
