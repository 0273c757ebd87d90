"""`python -m harvester` is the `harvester` command."""

import os
import sys

# Python has put the working folder first on the path; nothing there is meant.
if not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
    del sys.path[0]

from harvester.command_line import main

sys.exit(main())
