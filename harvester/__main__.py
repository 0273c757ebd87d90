"""`python -m harvester` is the `harvester` command."""

import sys

from harvester.command_line import main

sys.exit(main())
