"""`python -m mrdamp` is the command `mrdamp`."""

import sys

from mrdamp.cli import main

sys.exit(main())
