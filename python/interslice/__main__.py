"""`python -m interslice`: the command line."""

import sys

from interslice._command import main

sys.exit(main())
