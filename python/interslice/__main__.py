"""`python -m interslice`: the command line."""

import sys

from interslice._command import main

if __name__ == "__main__":
    sys.exit(main())
